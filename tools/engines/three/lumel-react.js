/**
 * Lumel's lightmaps in React Three Fiber (tried with 9.8, React 19).
 *
 *     import { LumelLevel } from 'lumel-three/react';
 *
 *     <Canvas flat>
 *       <Suspense fallback={null}><LumelLevel url="out/level.glb" /></Suspense>
 *     </Canvas>
 *
 * `flat` because React Three Fiber's own default is a film's tone curve, which changes colours.
 */
import { createElement } from 'react';
import { useLoader } from '@react-three/fiber';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { LumelLightmaps } from './lumel-lightmap.js';

/**
 * One loader for each set of options: React Three Fiber keeps what it loaded by loader and address, and a component that is suspended starts
 * over with new objects each time.
 */
const loaders = new Map();

function loaderFor(options) {
  const key = JSON.stringify(Object.entries(options).sort());
  if (!loaders.has(key)) {
    const loader = new GLTFLoader();
    loader.register((parser) => new LumelLightmaps(parser, options));
    loaders.set(key, loader);
  }
  return loaders.get(key);
}

/**
 * A level with its lightmaps; suspends until both are there.
 *
 * @param {string} url The .glb that `lumel bake` wrote.
 * @param {object} [options] Those of `attachLightmaps` that are plain values: `path`, `ktx2`, `exposure`, `diffuse`, `keepLights`.
 * @returns {object} What GLTFLoader gives; `userData.lumel` has what was attached, and the exposure.
 */
export function useLumelLevel(url, options = {}) {
  return useLoader(loaderFor(options), url);
}

/** Starts to load a level before a component asks for it. */
useLumelLevel.preload = (url, options = {}) => useLoader.preload(loaderFor(options), url);

/** The level as an object of the scene. Props that are no options go to it (`position`, `onClick`, …). */
export function LumelLevel({ url, path, ktx2, exposure, diffuse, keepLights, ...rest }) {
  const given = Object.entries({ path, ktx2, exposure, diffuse, keepLights }).filter(([, value]) => value !== undefined);
  const gltf = useLumelLevel(url, Object.fromEntries(given));
  return createElement('primitive', { object: gltf.scene, ...rest });
}
