/**
 * Lumel's lightmaps in React Three Fiber (tested with 9.8, React 19).
 *
 *     import { LumelLevel } from 'lumel-three/react';
 *
 *     <Canvas flat>
 *       <Suspense fallback={null}><LumelLevel url="out/level.glb" /></Suspense>
 *     </Canvas>
 *
 * `flat` turns off React Three Fiber's default filmic tone mapping, which changes colours.
 */
import { createElement } from 'react';
import { useLoader } from '@react-three/fiber';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { LumelLightmaps } from './lumel-lightmap.js';

/**
 * One loader for each set of options. React Three Fiber caches results by loader and URL, and a suspended component restarts with new
 * option objects each time.
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
 * A level with its lightmaps; suspends until both are loaded.
 *
 * @param {string} url The .glb that `lumel bake` wrote.
 * @param {object} [options] Options of `attachLightmaps` with plain values: `path`, `ktx2`, `exposure`, `diffuse`, `keepLights`.
 * @returns {object} The result of GLTFLoader; `userData.lumel` has the result of `attachLightmaps`.
 */
export function useLumelLevel(url, options = {}) {
  return useLoader(loaderFor(options), url);
}

/** Starts loading a level before a component needs it. */
useLumelLevel.preload = (url, options = {}) => useLoader.preload(loaderFor(options), url);

/** The level as an object in the scene. Other props (`position`, `onClick`, …) go to that object. */
export function LumelLevel({ url, path, ktx2, exposure, diffuse, keepLights, ...rest }) {
  const given = Object.entries({ path, ktx2, exposure, diffuse, keepLights }).filter(([, value]) => value !== undefined);
  const gltf = useLumelLevel(url, Object.fromEntries(given));
  return createElement('primitive', { object: gltf.scene, ...rest });
}
