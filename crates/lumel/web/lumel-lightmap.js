/**
 * Lumel's lightmaps in three.js (tested with r187).
 *
 *     import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
 *     import { attachLightmaps } from './lumel-lightmap.js';
 *
 *     const gltf = await new GLTFLoader().loadAsync('out/level.glb');
 *     await attachLightmaps(gltf);
 *     scene.add(gltf.scene);
 *
 * three.js treats a texel v of `lightMap` times lightMapIntensity as irradiance E, and a diffuse surface of albedo a reflects a E/π. A
 * Lumel lightmap contains R = E/π, so the intensity is π (`scaleToIrradiance`). Row 0 of a lightmap is at the top but EXRLoader puts it
 * at the bottom, so v is flipped.
 */
import {
  CanvasTexture, CompressedTexture, DataTexture, LinearFilter, LinearSRGBColorSpace, MeshLambertMaterial, Quaternion, RGBFormat, RGBAFormat,
  RGB_BPTC_UNSIGNED_Format, ShaderChunk, SRGBColorSpace, UnsignedByteType, UnsignedInt5999Type, Vector4,
} from 'three';

/**
 * Finds the page and rectangle of each mesh.
 *
 * glTF stores the rectangle on the node. three.js turns a node with one primitive into a mesh, and a node with several primitives into a
 * group of meshes. Instances of a glTF mesh share geometry and material and differ only in their rectangle.
 *
 * @param {object} gltf The result of GLTFLoader, or an Object3D of it (then only `userData` is searched).
 * @param {object} [manifest] `level.lightmap.json`, for files whose extras were removed by another tool.
 * @returns {{mesh: Mesh, node: Object3D, place: {uri, page, texCoord, offset, scale, scaleToIrradiance, exposure}}[]}
 */
export function findPlacements(gltf, manifest) {
  const root = gltf.scene ?? gltf;
  const associations = gltf.parser?.associations;
  const isNode = (object) =>
    associations ? associations.get(object)?.nodes !== undefined : object.userData.lightmap !== undefined;
  const found = [];
  root.traverse((mesh) => {
    if (!mesh.isMesh) return;
    let node = mesh;
    while (node && !isNode(node)) node = node.parent;
    if (!node) return;
    const place = valid(node.userData.lightmap) ?? fromManifest(manifest, associations?.get(node)?.nodes, node.name);
    // Without coordinates, this is an unbaked node below a baked one.
    if (place && mesh.geometry.getAttribute(`uv${place.texCoord}`)) found.push({ mesh, node, place });
  });
  return found;
}

/** `extras.lightmap`, if it is one. */
function valid(extra) {
  const pair = (x) => Array.isArray(x) && x.length === 2 && x.every(Number.isFinite);
  return extra && typeof extra.uri === 'string' && pair(extra.offset) && pair(extra.scale)
    ? { page: 0, texCoord: 1, scaleToIrradiance: Math.PI, ...extra }
    : undefined;
}

/** The same from the manifest: by the node's index, or by its name if indices are unknown and the name is unique. */
function fromManifest(manifest, index, name) {
  if (!manifest) return undefined;
  const nodes = manifest.nodes.filter((n) => (index === undefined ? n.name && n.name === name : n.node === index));
  if (nodes.length !== 1) return undefined;
  const [{ page, offset, scale }] = nodes;
  const { texCoord, scaleToIrradiance } = manifest;
  const { uri, ktx2 } = manifest.pages[page];
  return { uri, ktx2, page, texCoord, offset, scale, scaleToIrradiance, exposure: manifest.exposure };
}

/**
 * The exposure that the bake suggests: the factor from radiance to screen values, where 1 is white. Returns 1 if there is no suggestion.
 */
export function suggestedExposure(placements) {
  return placements[0]?.place.exposure ?? 1;
}

/**
 * Loads a level's pages and adds them to its materials.
 *
 * @param {object} gltf The result of GLTFLoader; changed in place.
 * @param {object} [options]
 * @param {string} [options.path] Folder of the pages. Default: the glTF's folder.
 * @param {object} [options.manifest] As in `findPlacements`.
 * @param {boolean} [options.ktx2] Load pages as KTX2 (`lumel bake --ktx2`); needs `./lumel-ktx2.js`.
 * @param {function(string): Promise<Texture>} [options.loadPage] Loads a page's texture from its URL. Default: EXRLoader.
 * @param {boolean} [options.topDown] Textures of `loadPage` have row 0 at the top (KTX2, raw data), unlike those of EXRLoader.
 * @param {number} [options.exposure] Factor for all light of the level: lightmaps, emission and lamps that stay. Default: the exposure
 *   that the bake suggests. Use 1 if the renderer has its own exposure.
 * @param {boolean} [options.diffuse] Replace materials by MeshLambertMaterial, which shows exactly the baked a × R. Otherwise
 *   MeshStandardMaterial shows 1 to 7 % less, most at grazing angles. Metals stay almost black, because they have no diffuse part.
 * @param {boolean} [options.keepLights] Keep the file's lamps for moving objects. Baked surfaces then get their light twice.
 * @returns {Promise<{meshes: number, materials: number, pages: Texture[], exposure: number}>}
 */
export async function attachLightmaps(gltf, options = {}) {
  const { manifest, ktx2 = false, topDown = ktx2, diffuse = false, keepLights = false } = options;
  const root = gltf.scene ?? gltf;
  const path = options.path ?? gltf.parser?.options.path ?? '';
  const loadPage = options.loadPage ?? (await (ktx2 ? ktx2Pages() : exrPages()));
  const placements = findPlacements(gltf, manifest);
  const exposure = options.exposure ?? suggestedExposure(placements);

  const pages = new Map();
  const materials = new Map();
  if (ktx2) {
    for (const found of placements) {
      if (!found.place.ktx2) throw new Error('this bake has no KTX2 pages: bake with --ktx2 bc6h or rgb9e5');
      found.place = { ...found.place, uri: found.place.ktx2.uri };
    }
  }
  for (const { place } of placements) {
    // The manifest has the plain file name; a URL needs it encoded.
    if (!pages.has(place.uri)) pages.set(place.uri, loadPage(path + encodeURIComponent(place.uri)));
  }
  for (const { place } of placements) {
    const uri = maskUri(place, ktx2);
    if (uri && !pages.has(uri)) pages.set(uri, loadPage(path + encodeURIComponent(uri)));
  }
  for (const [uri, page] of pages) pages.set(uri, await page);

  for (const { mesh, place } of placements) {
    if (!Number.isFinite(place.scaleToIrradiance)) {
      throw new Error('this lightmap holds radiosity, which three.js cannot light with: bake with --value radiance');
    }
    const each = (material) => {
      const lamps = place.mask?.lamps ?? [];
      const key = [material.uuid, place.uri, place.texCoord, ...place.offset, ...place.scale, ...lamps].join(' ');
      if (!materials.has(key)) {
        const own = diffuse ? diffuseMaterial(material) : material.clone();
        own.lightMap = placeTexture(pages.get(place.uri), place, topDown);
        own.lightMapIntensity = place.scaleToIrradiance * exposure;
        const mask = maskUri(place, ktx2);
        if (mask) useMask(own, placeTexture(pages.get(mask), place, topDown), place.mask.lamps);
        materials.set(key, own);
      }
      return materials.get(key);
    };
    mesh.material = Array.isArray(mesh.material) ? mesh.material.map(each) : each(mesh.material);
    if (place.mask) followLights(mesh);
  }
  if (!keepLights) removeLights(root);
  await projectCookies(gltf);
  expose(root, exposure);
  return { meshes: placements.length, materials: materials.size, pages: [...pages.values()], exposure };
}

/**
 * A GLTFLoader plugin that attaches lightmaps to each level it loads.
 *
 *     loader.register((parser) => new LumelLightmaps(parser, options));
 *
 * Options are those of `attachLightmaps`, whose result is in `gltf.userData.lumel`.
 */
export class LumelLightmaps {
  constructor(parser, options = {}) {
    this.name = 'LUMEL_lightmaps';
    this.parser = parser;
    this.options = options;
  }

  async afterRoot(gltf) {
    const path = this.parser.options.path;
    gltf.userData.lumel = await attachLightmaps(gltf, { path, ...this.options });
  }
}

/**
 * A page's texture with the transform of one instance. Clones share the image on the GPU.
 *
 * page = offset + scale × uv, with v from the top. A texture whose row 0 is at the bottom has v' = 1 − v.
 */
export function placeTexture(page, place, topDown = false) {
  const texture = page.clone();
  const [u, v] = place.offset;
  const [w, h] = place.scale;
  texture.channel = place.texCoord;
  texture.colorSpace = LinearSRGBColorSpace;
  // The charts' padding is too narrow for mip levels, which would mix neighbouring charts.
  texture.minFilter = texture.magFilter = LinearFilter;
  texture.generateMipmaps = false;
  texture.offset.set(u, topDown ? v : 1 - v);
  texture.repeat.set(w, topDown ? h : -h);
  texture.needsUpdate = true;
  return texture;
}

/** A Lambertian material that looks like `from`, as the bake assumes. */
export function diffuseMaterial(from) {
  const to = new MeshLambertMaterial();
  const same = ['name', 'map', 'alphaMap', 'alphaTest', 'opacity', 'transparent', 'side', 'vertexColors', 'flatShading', 'depthWrite', 'visible'];
  for (const key of same) if (from[key] !== undefined) to[key] = from[key];
  if (from.color) to.color.copy(from.color);
  if (from.emissive) {
    to.emissive.copy(from.emissive);
    to.emissiveMap = from.emissiveMap;
    to.emissiveIntensity = from.emissiveIntensity;
  }
  if (from.transmission > 0) {
    // Light passes straight through the transmissive part; the rest reflects.
    to.transparent = true;
    to.opacity = Math.max(0.15, 1 - from.transmission);
    to.depthWrite = false;
  }
  to.userData = from.userData;
  return to;
}

/** Scales emission and lamps, so that they keep their ratio to the lightmap. */
function expose(root, exposure) {
  const glowing = new Set();
  root.traverse((object) => {
    if (object.isLight) object.intensity *= exposure;
    for (const material of [object.material ?? []].flat()) if (material.emissive) glowing.add(material);
  });
  for (const material of glowing) material.emissiveIntensity *= exposure;
}

/** `{id, mode, channel}` of a lamp whose direct light is not in the lightmap; undefined for other lamps. */
export function lampOf(light) {
  return light.userData.lightmapLamp ?? light.parent?.userData.lightmapLamp;
}

/**
 * Gives mixed and realtime spots the pictures that they project: `extras.lumel.cookie`, as index of a texture. The bake has read pictures
 * beside the level (a URI), but does not copy them.
 */
async function projectCookies(gltf) {
  const { json, associations } = gltf.parser ?? {};
  if (!json) return;
  const spots = [];
  gltf.scene.traverse((object) => object.isSpotLight && lampOf(object) && spots.push(object));
  for (const spot of spots) {
    const node = json.nodes[(associations.get(spot) ?? associations.get(spot.parent))?.nodes];
    const index = node?.extensions?.KHR_lights_punctual?.light;
    const light = json.extensions?.KHR_lights_punctual?.lights[index];
    const cookie = node?.extras?.lumel?.cookie ?? light?.extras?.lumel?.cookie;
    if (!Number.isInteger(cookie)) continue;
    const { image } = await gltf.parser.getDependency('texture', cookie);
    // Unlike an ImageBitmap, a canvas is turned over when it is uploaded, as SpotLight.map expects.
    const canvas = document.createElement('canvas');
    [canvas.width, canvas.height] = [image.width, image.height];
    canvas.getContext('2d').drawImage(image, 0, 0);
    spot.map = new CanvasTexture(canvas);
    spot.map.colorSpace = SRGBColorSpace;
    spot.map.generateMipmaps = false;
    spot.map.minFilter = LinearFilter;
    // The picture's top is the node's +Y.
    const { camera } = spot.shadow;
    camera.up.set(0, 1, 0).applyQuaternion(spot.getWorldQuaternion(new Quaternion()));
    camera.near = 0.01;
    camera.updateProjectionMatrix();
  }
}

/** File name of a node's shadow mask, if it has one. */
function maskUri(place, ktx2) {
  return ktx2 ? place.mask?.ktx2?.uri : place.mask?.uri;
}

/** The mask channel of each light in a scene, in the order in which three.js numbers lights of a type. */
function selectors(scene, lamps) {
  const lights = [];
  scene.traverseVisible((object) => object.isLight && lights.push(object));
  // The order of WebGLLights: lights with shadow maps and textures come first, and sorting is stable.
  const rank = (light) => (light.castShadow ? 2 : 0) + (light.map ? 1 : 0);
  lights.sort((a, b) => rank(b) - rank(a));
  const one = (light) => {
    const lamp = lampOf(light);
    // Lights of the application and lamps with shadow maps are not masked.
    if (!lamp || lamp.mode !== 'mixed' || lamp.channel === undefined) return new Vector4(-1, 0, 0, 0);
    const channel = lamps.indexOf(lamp.id);
    return new Vector4(...[0, 1, 2, 3].map((c) => (c === channel ? 1 : 0)));
  };
  const of = (kind) => lights.filter((light) => light[kind]).map(one);
  return { point: of('isPointLight'), spot: of('isSpotLight'), directional: of('isDirectionalLight') };
}

/** Uniforms and lamps by material. They are not in `userData`, because cloning a material serialises it. */
const masks = new WeakMap();

/** Makes a material multiply the light of mixed lamps by the mask. */
function useMask(material, texture, lamps) {
  const uniforms = {
    lumelMask: { value: texture },
    lumelPoint: { value: [] },
    lumelSpot: { value: [] },
    lumelDirectional: { value: [] },
  };
  masks.set(material, { uniforms, lamps });
  material.customProgramCacheKey = () => 'lumel-mask';
  material.onBeforeCompile = (shader) => {
    Object.assign(shader.uniforms, uniforms);
    const kinds = [['POINT', 'Point', 'point'], ['SPOT', 'Spot', 'spot'], ['DIR', 'Directional', 'directional']];
    const declare = kinds.map(
      ([define, name]) => `#if NUM_${define}_LIGHTS > 0\nuniform vec4 lumel${name}[ NUM_${define}_LIGHTS ];\n#endif\n`,
    );
    const head = `uniform sampler2D lumelMask;\n${declare.join('')}
float lumelVisible( const in vec4 selector ) {
  return selector.x < 0.0 ? 1.0 : clamp( dot( texture2D( lumelMask, vLightMapUv ), selector ), 0.0, 1.0 );
}
`;
    let body = ShaderChunk.lights_fragment_begin;
    for (const [, name, kind] of kinds) {
      const call = new RegExp(`get${name}LightInfo\\( ${kind}Light,.*?\\);`);
      if (!call.test(body)) throw new Error(`this version of three.js lights in another way: ${name}`);
      body = body.replace(call, (found) => `${found}\n\t\tdirectLight.color *= lumelVisible( lumel${name}[ i ] );`);
    }
    shader.fragmentShader = shader.fragmentShader
      .replace('#include <lights_pars_begin>', `#include <lights_pars_begin>\n${head}`)
      .replace('#include <lights_fragment_begin>', body);
  };
}

/** Updates the mask channels of a mesh's materials when the lights of its scene change. */
function followLights(mesh) {
  const before = mesh.onBeforeRender;
  mesh.onBeforeRender = function (renderer, scene, camera, geometry, material, group) {
    before.call(this, renderer, scene, camera, geometry, material, group);
    const mask = masks.get(material);
    if (!mask || !scene.isScene) return;
    const { point, spot, directional } = selectors(scene, mask.lamps);
    mask.uniforms.lumelPoint.value = point;
    mask.uniforms.lumelSpot.value = spot;
    mask.uniforms.lumelDirectional.value = directional;
    material.uniformsNeedUpdate = true;
  };
}

/** Removes lamps whose light is in the lightmap. */
export function removeLights(root) {
  const lights = [];
  root.traverse((object) => object.isLight && !lampOf(object) && lights.push(object));
  for (const light of lights) light.removeFromParent();
}

async function exrPages() {
  const { EXRLoader } = await import('three/addons/loaders/EXRLoader.js');
  const loader = new EXRLoader();
  return (url) => loader.loadAsync(url);
}

/** three.js's KTX2Loader (r187) supports rgb9e5 but not BC6H. */
async function ktx2Pages() {
  const { fetchKtx2 } = await import('./lumel-ktx2.js');
  return async (url) => {
    const { width, height, format, data } = await fetchKtx2(url);
    const texture =
      format === 'bc6h'
        ? new CompressedTexture([{ data, width, height }], width, height, RGB_BPTC_UNSIGNED_Format)
        : format === 'rgba8'
          ? new DataTexture(data, width, height, RGBAFormat, UnsignedByteType)
          : new DataTexture(data, width, height, RGBFormat, UnsignedInt5999Type);
    texture.needsUpdate = true;
    return texture;
  };
}
