/**
 * Lumel's lightmaps in Babylon.js (tested with 9.28).
 *
 *     const { level } = await loadLevel(BABYLON, scene, 'out/level.glb');
 *
 * Babylon's PBR material adds a texel v of `lightmapTexture` to its output, whatever the albedo. With `useLightmapAsShadowmap` it
 * multiplies by v instead. Together with `unlit`, which shows the albedo, the result is albedo × v. A Lumel lightmap contains R = E/π, the
 * radiance of a white surface, so no factor is needed.
 *
 * With mixed or realtime lamps (`--mode`), baked materials stay lit: diffuse, without gloss, as the bake assumes.
 */

/** Loads a .glb and its lightmaps; `options` as below. */
export async function loadLevel(BABYLON, scene, url, options = {}) {
  // An InstancedMesh shares the material of its original, but the lightmap's rectangle is a property of the material.
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
 * @param {string} [options.folder] Folder of the pages, ending in a slash.
 * @param {number} [options.exposure] Factor for all light of the level: lightmaps, emission and lamps that stay. Default: the exposure
 *   that the bake suggests. Use 1 if the scene has its own exposure.
 * @param {boolean} [options.keepLights] Keep the file's lamps for moving objects. Baked surfaces are unlit, so lamps do not affect them.
 *   Mixed and realtime lamps always stay.
 * @param {string} [options.fflate] URL of fflate (npm) for EXR files. Babylon loads it from a CDN by default.
 * @returns {Promise<{meshes: number, materials: number, pages: object[], exposure: number}>}
 */
export async function attachLightmaps(BABYLON, scene, level, options = {}) {
  const { folder = '', keepLights = false, fflate } = options;
  if (fflate) BABYLON.ExrLoaderGlobalConfiguration.FFLATEUrl = fflate;
  const lit = [];
  for (const mesh of level.meshes) {
    const place = placeOf(mesh);
    // Without coordinates, a mesh cannot be lightmapped.
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
  for (const uri of new Set(lit.flatMap(({ place }) => place.mask?.uri ?? []))) {
    pages.set(uri, loadPage(BABYLON, scene, folder + encodeURIComponent(uri)));
  }
  for (const [uri, page] of pages) pages.set(uri, await page);
  const lamps = level.lights.filter(lampOf);

  // Instances share a material but have different rectangles, so each gets a copy.
  const materials = new Map();
  for (const { mesh, place } of lit) {
    const from = mesh.material ?? scene.defaultMaterial;
    const key = [from.uniqueId, place.uri, ...place.offset, ...place.scale, ...(place.mask?.lamps ?? [])].join(' ');
    if (!materials.has(key)) {
      const own = from.clone(from.name);
      own.lightmapTexture = placed(pages.get(place.uri), place, exposure);
      own.useLightmapAsShadowmap = lamps.length === 0;
      own.unlit = lamps.length === 0;
      if (lamps.length > 0) {
        makeDiffuse(BABYLON, own);
        own.maxSimultaneousLights = lamps.length + 4;
        const mask = place.mask && placed(pages.get(place.mask.uri), place, 1);
        useMask(BABYLON, own, mask, place.mask?.lamps ?? []);
      }
      materials.set(key, own);
    }
    mesh.material = materials.get(key);
  }
  if (!keepLights) for (const light of level.lights) light.setEnabled(lamps.includes(light));
  // Emission and lamps keep their ratio to the lightmap.
  for (const light of level.lights) light.intensity *= exposure;
  for (const material of new Set(level.meshes.map((mesh) => mesh.material))) {
    if (material?.emissiveIntensity !== undefined) material.emissiveIntensity *= exposure;
  }
  return { meshes: lit.length, materials: materials.size, pages: [...pages.values()], exposure };
}

/** `{id, mode, channel}` of a lamp whose direct light is not in the lightmap; undefined for other lamps. */
export function lampOf(light) {
  return light.metadata?.lightmapLamp ?? light.parent?.metadata?.gltf?.extras?.lightmapLamp;
}

/** Lambert's law, without gloss. */
function makeDiffuse(BABYLON, material) {
  material.metallic = 0;
  material.metallicTexture = null;
  material.metallicF0Factor = 0;
  material.roughness = 1;
  material.brdf.baseDiffuseModel = BABYLON.Constants.MATERIAL_DIFFUSE_MODEL_LAMBERT;
}

/**
 * Makes a lit material multiply its lightmap by the albedo, and mixed lamps by the shadow mask, if there is one.
 *
 * Babylon numbers a mesh's lights in the order of `lightSources`, and its shaders have a hook at each light's colour.
 */
function useMask(BABYLON, material, mask, channels) {
  const count = material.maxSimultaneousLights;
  const code = { CUSTOM_FRAGMENT_BEFORE_FINALCOLORCOMPOSITION: 'lightmapColor.rgb *= surfaceAlbedo;' };
  if (mask) {
    code.CUSTOM_FRAGMENT_DEFINITIONS = `uniform sampler2D lumelMask;
float lumelVisible(vec4 lamp, vec4 mask) { return lamp.x < 0.0 ? 1.0 : clamp(dot(mask, lamp), 0.0, 1.0); }`;
    code.CUSTOM_FRAGMENT_BEFORE_LIGHTS = 'vec4 lumelMasked = texture2D(lumelMask, vLightmapUV);';
    for (let i = 0; i < count; i += 1) {
      code[`CUSTOM_LIGHT${i}_COLOR`] = `diffuse${i}.rgb *= lumelVisible(lumelLamps[${i}], lumelMasked);`;
    }
  }
  // The base class calls these methods in its constructor.
  class Plugin extends BABYLON.MaterialPluginBase {
    // Materials of one class share shaders.
    getClassName() {
      return `Lumel${mask ? 'Masked' : 'Lit'}${count}`;
    }

    getSamplers(samplers) {
      if (mask) samplers.push('lumelMask');
    }

    getUniforms() {
      return { ubo: [{ name: 'lumelLamps', size: 4, type: 'vec4', arraySize: count }] };
    }

    bindForSubMesh(uniforms, _scene, _engine, subMesh) {
      const lights = subMesh.getMesh().lightSources;
      uniforms.updateArray('lumelLamps', Array.from({ length: count }, (_, i) => selector(lights[i], channels)).flat());
      if (mask) uniforms.setTexture('lumelMask', mask);
    }

    getCustomCode(kind) {
      return kind === 'fragment' ? code : null;
    }
  }
  const plugin = new Plugin(material, 'Lumel', 200, undefined, true, true);
  plugin.doNotSerialize = true;
}

/** A lamp's channel of the mask as a vector; −1 first if it is not masked: realtime, with shadow maps, or the application's own. */
function selector(light, channels) {
  const lamp = light && lampOf(light);
  if (!lamp || lamp.mode !== 'mixed' || lamp.channel === undefined || light.getShadowGenerator()) return [-1, 0, 0, 0];
  const channel = channels.indexOf(lamp.id);
  return [0, 1, 2, 3].map((c) => (c === channel ? 1 : 0));
}

/** A node's extras. With several primitives, they are on the parent of the meshes. */
function placeOf(mesh) {
  for (const node of [mesh, mesh.parent]) {
    const place = node?.metadata?.gltf?.extras?.lightmap;
    if (place?.uri) return place;
    // Only primitives inherit from the parent, not child nodes with meshes.
    if (node === mesh && !/_primitive\d+$/.test(mesh.name)) return undefined;
  }
  return undefined;
}

function placed(page, { offset: [u, v], scale: [w, h], texCoord }, exposure) {
  const texture = page.clone();
  // Clones do not copy this flag. Without it, Babylon would decode the light as sRGB.
  texture.gammaSpace = false;
  texture.coordinatesIndex = texCoord;
  // Filtering must not wrap around the page's border.
  texture.wrapU = texture.wrapV = 0;
  // Babylon's EXR reader puts row 0 at the bottom with or without `invertY`: v' = 1 − v.
  texture.uScale = w;
  texture.vScale = -h;
  texture.uOffset = u;
  texture.vOffset = 1 - v;
  // Scale about the corner, not the centre.
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
