/**
 * Lumel's reflection captures in three.js (tested with r187, WebGLRenderer).
 *
 *     import { loadReflections, useReflections } from './lumel-reflections.js';
 *
 *     const { exposure } = await attachLightmaps(gltf);
 *     useReflections(scene, await loadReflections(gltf), exposure);
 *
 * Needs materials that reflect, i.e. no `diffuse: true`.
 */
import { Box3, CubeTexture, DataTexture, LinearFilter, LinearSRGBColorSpace, RGBFormat, UnsignedInt5999Type, Vector3 } from 'three';
import { parseCubeKtx2 } from './lumel-ktx2.js';
import { changeChunk } from './lumel-probes.js';

/**
 * Loads the captures that a bake's .glb names.
 *
 * @param {object} gltf The result of GLTFLoader.
 * @param {string} [path] Folder of the cube maps. Default: the glTF's folder.
 * @returns {Promise<{position: Vector3, texture: CubeTexture}[]>}
 */
export async function loadReflections(gltf, path = gltf.parser?.options.path ?? '') {
  const nodes = [];
  gltf.scene.traverse((node) => node.userData.lightmapReflection && nodes.push(node));
  return Promise.all(
    nodes.map(async (node) => {
      const texture = await loadReflection(path + encodeURIComponent(node.userData.lightmapReflection.uri));
      return { position: node.getWorldPosition(new Vector3()), texture };
    }),
  );
}

/** Loads one capture as a CubeTexture. three.js blurs it for rough materials itself. */
export async function loadReflection(url) {
  const response = await fetch(url);
  if (!response.ok) throw new Error(`${url}: ${response.status} ${response.statusText}`);
  const { size, faces } = parseCubeKtx2(await response.arrayBuffer());
  // The file negates z, three.js x: one is the other turned by half a turn about y. That swaps the sides and turns top and bottom.
  const [px, nx, py, ny, pz, nz] = faces;
  const turned = [nx, px, py.slice().reverse(), ny.slice().reverse(), nz, pz];
  const images = turned.map((data) => new DataTexture(data, size, size, RGBFormat, UnsignedInt5999Type));
  const texture = new CubeTexture(images);
  texture.format = RGBFormat;
  texture.type = UnsignedInt5999Type;
  texture.colorSpace = LinearSRGBColorSpace;
  texture.minFilter = texture.magFilter = LinearFilter;
  texture.generateMipmaps = false;
  texture.needsUpdate = true;
  return texture;
}

/**
 * Gives each mesh the capture nearest to its middle. Only reflections: diffuse light comes from lightmaps and probes.
 *
 * @param {Object3D} root
 * @param {{position: Vector3, texture: CubeTexture}[]} reflections
 * @param {number} [exposure] As `attachLightmaps` returns it.
 */
export function useReflections(root, reflections, exposure = 1) {
  if (reflections.length === 0) return;
  root.updateMatrixWorld(true);
  const materials = new Map();
  const box = new Box3();
  const middle = new Vector3();
  root.traverse((mesh) => {
    if (!mesh.isMesh) return;
    box.setFromObject(mesh).getCenter(middle);
    const far = ({ position }) => position.distanceToSquared(middle);
    const { texture } = reflections.reduce((a, b) => (far(a) <= far(b) ? a : b));
    const each = (material) => {
      if (!material.isMeshStandardMaterial) return material;
      const key = `${material.uuid} ${texture.uuid}`;
      if (!materials.has(key)) materials.set(key, reflecting(material, texture, exposure));
      return materials.get(key);
    };
    mesh.material = Array.isArray(mesh.material) ? mesh.material.map(each) : each(mesh.material);
  });
}

function reflecting(material, texture, exposure) {
  // The first capture changes the material itself, because clones lose what loaders changed in its shader.
  if (material.envMap && material.envMap !== texture) {
    const own = material.clone();
    own.onBeforeCompile = material.onBeforeCompile;
    own.customProgramCacheKey = material.customProgramCacheKey;
    own.envMap = texture;
    return own;
  }
  material.envMap = texture;
  material.envMapIntensity = exposure;
  changeChunk(material, 'lights_fragment_maps', [['iblIrradiance += getIBLIrradiance( geometryNormal );', '']], 'lumel-reflections');
  return material;
}
