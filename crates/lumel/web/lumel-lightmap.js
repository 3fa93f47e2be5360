/**
 * Lumel's lightmaps in three.js (tried with r187).
 *
 *     import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
 *     import { attachLightmaps } from './lumel-lightmap.js';
 *
 *     const gltf = await new GLTFLoader().loadAsync('out/level.glb');
 *     await attachLightmaps(gltf);
 *     scene.add(gltf.scene);
 *
 * What three.js does with a texel v of `lightMap`: it takes v × lightMapIntensity for an irradiance E, and a diffuse surface of
 * albedo a sends out a E/π. A Lumel lightmap holds R = E/π, so the intensity is π (`scaleToIrradiance`). Its row 0 is at the top, and
 * EXRLoader's at the bottom, so v runs backwards.
 */
import {
  CompressedTexture, DataTexture, LinearFilter, LinearSRGBColorSpace, MeshLambertMaterial, RGBFormat, RGB_BPTC_UNSIGNED_Format,
  UnsignedInt5999Type,
} from 'three';

/**
 * Which part of which page belongs to each mesh.
 *
 * glTF keeps the place on the node; three.js makes a mesh of a node with one primitive, and a group with one mesh for each of
 * several primitives. Instances of one glTF mesh share a geometry and a material, and differ only here.
 *
 * @param {object} gltf What GLTFLoader gives, or an Object3D of it (then places are found by `userData` alone).
 * @param {object} [manifest] `level.lightmap.json`, for files whose extras some tool has dropped.
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
    // Without coordinates there is nothing to look up: a node that the bake left out under one that it did not.
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

/** The same from the manifest: by the node's number, or by its name where numbers are unknown and the name is no other's. */
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
 * The exposure that the bake suggests for what `findPlacements` found: radiance × this is what a screen shows, 1 being white. 1 for bakes
 * that suggest none.
 */
export function suggestedExposure(placements) {
  return placements[0]?.place.exposure ?? 1;
}

/**
 * Loads the pages that a level needs and puts them on its materials.
 *
 * @param {object} gltf What GLTFLoader gives; changed in place.
 * @param {object} [options]
 * @param {string} [options.path] Folder of the pages; where the glTF came from unless given.
 * @param {object} [options.manifest] As in `findPlacements`.
 * @param {boolean} [options.ktx2] Load pages as KTX2 (`lumel bake --ktx2`); needs `./lumel-ktx2.js`.
 * @param {function(string): Promise<Texture>} [options.loadPage] Makes a texture from a page's address; EXRLoader unless given.
 * @param {boolean} [options.topDown] Textures of `loadPage` have row 0 at the top (KTX2, raw data), unlike EXRLoader's.
 * @param {number} [options.exposure] Multiplies all light of the level: lightmaps, what glows, and lamps that are kept. The bake's own
 *   suggestion unless given; 1 leaves radiance as it is, for a renderer with an exposure of its own.
 * @param {boolean} [options.diffuse] Materials become MeshLambertMaterial: a × R exactly, as it was baked. Else they stay, and
 *   MeshStandardMaterial shows 1 to 7 % less, most at grazing angles (and metals next to nothing, since they have no diffuse part).
 * @param {boolean} [options.keepLights] Leave the file's lamps on: for what moves, while baked surfaces get their light twice.
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
    // The name is a plain file name; as part of an address it is encoded.
    if (!pages.has(place.uri)) pages.set(place.uri, loadPage(path + encodeURIComponent(place.uri)));
  }
  for (const [uri, page] of pages) pages.set(uri, await page);

  for (const { mesh, place } of placements) {
    if (!Number.isFinite(place.scaleToIrradiance)) {
      throw new Error('this lightmap holds radiosity, which three.js cannot light with: bake with --value radiance');
    }
    const each = (material) => {
      const key = [material.uuid, place.uri, place.texCoord, ...place.offset, ...place.scale].join(' ');
      if (!materials.has(key)) {
        const own = diffuse ? diffuseMaterial(material) : material.clone();
        own.lightMap = placeTexture(pages.get(place.uri), place, topDown);
        own.lightMapIntensity = place.scaleToIrradiance * exposure;
        materials.set(key, own);
      }
      return materials.get(key);
    };
    mesh.material = Array.isArray(mesh.material) ? mesh.material.map(each) : each(mesh.material);
  }
  if (!keepLights) removeLights(root);
  expose(root, exposure);
  return { meshes: placements.length, materials: materials.size, pages: [...pages.values()], exposure };
}

/**
 * A plug-in of GLTFLoader: what it loads has its lightmaps.
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
 * A page's texture as one instance sees it. Clones share the picture on the graphics card; only the transform is their own.
 *
 * page = offset + scale × uv, with v from the top. A texture whose row 0 is at the bottom has v' = 1 − v.
 */
export function placeTexture(page, place, topDown = false) {
  const texture = page.clone();
  const [u, v] = place.offset;
  const [w, h] = place.scale;
  texture.channel = place.texCoord;
  texture.colorSpace = LinearSRGBColorSpace;
  // Charts have no room for mips: smaller levels would mix neighbours.
  texture.minFilter = texture.magFilter = LinearFilter;
  texture.generateMipmaps = false;
  texture.offset.set(u, topDown ? v : 1 - v);
  texture.repeat.set(w, topDown ? h : -h);
  texture.needsUpdate = true;
  return texture;
}

/** A Lambertian material that looks like `from`: what the light was baked for. */
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
    // Glass lets light straight through; the rest of it reflects.
    to.transparent = true;
    to.opacity = Math.max(0.15, 1 - from.transmission);
    to.depthWrite = false;
  }
  to.userData = from.userData;
  return to;
}

/** What glows and what shines keep their ratio to the lightmap. */
function expose(root, exposure) {
  const glowing = new Set();
  root.traverse((object) => {
    if (object.isLight) object.intensity *= exposure;
    for (const material of [object.material ?? []].flat()) if (material.emissive) glowing.add(material);
  });
  for (const material of glowing) material.emissiveIntensity *= exposure;
}

/** Takes lamps out: their light is in the lightmap. */
export function removeLights(root) {
  const lights = [];
  root.traverse((object) => object.isLight && lights.push(object));
  for (const light of lights) light.removeFromParent();
}

async function exrPages() {
  const { EXRLoader } = await import('three/addons/loaders/EXRLoader.js');
  const loader = new EXRLoader();
  return (url) => loader.loadAsync(url);
}

/** three's own KTX2Loader (r187) knows rgb9e5 but not BC6H. */
async function ktx2Pages() {
  const { fetchKtx2 } = await import('./lumel-ktx2.js');
  return async (url) => {
    const { width, height, format, data } = await fetchKtx2(url);
    const texture =
      format === 'bc6h'
        ? new CompressedTexture([{ data, width, height }], width, height, RGB_BPTC_UNSIGNED_Format)
        : new DataTexture(data, width, height, RGBFormat, UnsignedInt5999Type);
    texture.needsUpdate = true;
    return texture;
  };
}
