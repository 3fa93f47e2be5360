/**
 * Lumel's lightmaps in Babylon.js (tried with 9.28).
 *
 *     const { level } = await loadLevel(BABYLON, scene, 'out/level.glb');
 *
 * What Babylon's PBR material does with a texel v of `lightmapTexture`: it adds v to what it shows, whatever the albedo. With
 * `useLightmapAsShadowmap` it multiplies instead; together with `unlit`, which shows the albedo, that is albedo × v. A Lumel lightmap holds
 * R = E/π, the radiance of a white surface, so there is no factor.
 */

/** Loads a .glb and its lightmaps; `options` as below. */
export async function loadLevel(BABYLON, scene, url, options = {}) {
  // An InstancedMesh has its original's material, and a lightmap's place is the material's here.
  const level = await BABYLON.LoadAssetContainerAsync(url, scene, { pluginOptions: { gltf: { createInstances: false } } });
  level.addAllToScene();
  const folder = url.slice(0, url.lastIndexOf('/') + 1);
  return { level, ...(await attachLightmaps(BABYLON, scene, level, { folder, ...options })) };
}

/**
 * @param {object} BABYLON The module or global.
 * @param {object} scene
 * @param {object} level An AssetContainer (or anything with `meshes` and `lights`) from a .glb that `lumel bake` wrote.
 * @param {object} [options]
 * @param {string} [options.folder] Where the pages are, with its slash.
 * @param {number} [options.exposure] Multiplies all light of the level: lightmaps, what glows, and lamps that are kept. The bake's own
 *   suggestion unless given; 1 leaves radiance as it is, for a scene with an exposure of its own.
 * @param {boolean} [options.keepLights] Leave the file's lamps on, for what moves; baked surfaces here are unlit, and do not see them.
 * @param {string} [options.fflate] Address of fflate (npm) for EXR files; Babylon's own default is on another server.
 * @returns {Promise<{meshes: number, materials: number, pages: object[], exposure: number}>}
 */
export async function attachLightmaps(BABYLON, scene, level, options = {}) {
  const { folder = '', keepLights = false, fflate } = options;
  if (fflate) BABYLON.ExrLoaderGlobalConfiguration.FFLATEUrl = fflate;
  const lit = [];
  for (const mesh of level.meshes) {
    const place = placeOf(mesh);
    // Without coordinates there is nothing to look up.
    if (place && mesh.getVerticesData(BABYLON.VertexBuffer.UV2Kind)) {
      if (mesh.getClassName() === 'InstancedMesh') throw new Error('instances share a place: load with createInstances: false');
      lit.push({ mesh, place });
    }
  }
  const exposure = options.exposure ?? lit[0]?.place.exposure ?? 1;
  const pages = new Map();
  for (const { place } of lit) {
    if (!pages.has(place.uri)) pages.set(place.uri, loadPage(BABYLON, scene, folder + encodeURIComponent(place.uri)));
  }
  for (const [uri, page] of pages) pages.set(uri, await page);

  // Instances share a material and differ in their place: one copy for each.
  const materials = new Map();
  for (const { mesh, place } of lit) {
    const from = mesh.material ?? scene.defaultMaterial;
    const key = [from.uniqueId, place.uri, ...place.offset, ...place.scale].join(' ');
    if (!materials.has(key)) {
      const own = from.clone(from.name);
      own.lightmapTexture = placed(pages.get(place.uri), place, exposure);
      own.useLightmapAsShadowmap = true;
      own.unlit = true;
      materials.set(key, own);
    }
    mesh.material = materials.get(key);
  }
  if (!keepLights) for (const light of level.lights) light.setEnabled(false);
  // What glows and what shines keep their ratio to the lightmap.
  for (const light of level.lights) light.intensity *= exposure;
  for (const material of new Set(level.meshes.map((mesh) => mesh.material))) {
    if (material?.emissiveIntensity !== undefined) material.emissiveIntensity *= exposure;
  }
  return { meshes: lit.length, materials: materials.size, pages: [...pages.values()], exposure };
}

/** A node's extras; its mesh has them, or, of several primitives, the node above. */
function placeOf(mesh) {
  for (const node of [mesh, mesh.parent]) {
    const place = node?.metadata?.gltf?.extras?.lightmap;
    if (place?.uri) return place;
    // A child with a mesh of its own and no place has none from its parent: only primitives inherit.
    if (node === mesh && !/_primitive\d+$/.test(mesh.name)) return undefined;
  }
  return undefined;
}

function placed(page, { offset: [u, v], scale: [w, h], texCoord }, exposure) {
  const texture = page.clone();
  // Clones do not take it over; without it light is taken for sRGB.
  texture.gammaSpace = false;
  texture.coordinatesIndex = texCoord;
  // Charts have no room for what lies over the border.
  texture.wrapU = texture.wrapV = 0;
  // Babylon's reader of EXRs puts row 0 at the bottom, `invertY` or not: v' = 1 − v.
  texture.uScale = w;
  texture.vScale = -h;
  texture.uOffset = u;
  texture.vOffset = 1 - v;
  // Scale about the corner, not the middle.
  texture.uRotationCenter = texture.vRotationCenter = 0;
  texture.level = exposure;
  return texture;
}

function loadPage(BABYLON, scene, url) {
  return new Promise((resolve, reject) => {
    const texture = new BABYLON.Texture(url, scene, {
      noMipmap: true,
      invertY: false,
      samplingMode: BABYLON.Texture.BILINEAR_SAMPLINGMODE,
      onLoad: () => resolve(texture),
      onError: (message) => reject(new Error(`${url}: ${message}`)),
    });
  });
}
