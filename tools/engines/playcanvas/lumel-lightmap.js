/**
 * Lumel's lightmaps in PlayCanvas (tested with engine 2.23).
 *
 *     import * as pc from 'playcanvas';
 *     import { loadLevel } from './lumel-lightmap.js';
 *
 *     const { entity } = await loadLevel(pc, app, 'out/level.glb');
 *     app.root.addChild(entity);
 *
 * PlayCanvas adds a texel v of `lightMap` to the diffuse light and multiplies the sum by the albedo. A Lumel lightmap contains R = E/π, the
 * radiance of a white surface, so no factor is needed. PlayCanvas cannot read EXR: bake with `--ktx2 rgb9e5` (or bc6h if the GPU supports it).
 */
import { fetchKtx2 } from '../three/lumel-ktx2.js';

/** Tags survive the copy that PlayCanvas makes of a loaded hierarchy; other properties do not. */
const TAG = 'lumel:';

/**
 * @param {object} pc The module `playcanvas`.
 * @param {object} app The application.
 * @param {string} url The .glb that `lumel bake --ktx2` wrote.
 * @param {object} [options]
 * @param {number} [options.exposure] Becomes `app.scene.exposure`, a factor for the whole scene. Default: the exposure that the bake suggests.
 * @param {boolean} [options.keepLights] Keep the file's lamps. Baked surfaces then get their light twice.
 * @returns {Promise<{entity: object, meshes: number, pages: object[], exposure: number}>}
 */
export async function loadLevel(pc, app, url, options = {}) {
  const asset = new pc.Asset('level', 'container', { url }, null, {
    node: {
      postprocess(gltfNode, node) {
        const place = gltfNode.extras?.lightmap;
        if (place?.uri) node.tags.add(TAG + JSON.stringify(place));
      },
    },
  });
  await new Promise((resolve, reject) => {
    asset.ready(resolve);
    asset.once('error', (error) => reject(new Error(`${url}: ${error}`)));
    app.assets.add(asset);
    app.assets.load(asset);
  });
  const entity = asset.resource.instantiateRenderEntity();
  return { entity, ...(await attachLightmaps(pc, app, entity, { folder: url.slice(0, url.lastIndexOf('/') + 1), ...options })) };
}

/** Puts lightmaps on the render components of a hierarchy whose nodes have tags from `loadLevel`. */
export async function attachLightmaps(pc, app, entity, options = {}) {
  const { folder = '', keepLights = false } = options;
  const lit = [];
  for (const render of entity.findComponents('render')) {
    const tag = render.entity.tags.list().find((t) => t.startsWith(TAG));
    if (tag) lit.push({ render, place: JSON.parse(tag.slice(TAG.length)) });
  }
  const pages = new Map();
  for (const { place } of lit) {
    if (!place.ktx2) throw new Error('this bake has no KTX2 pages: bake with --ktx2 rgb9e5');
    const { uri } = place.ktx2;
    // The manifest has the plain file name; a URL needs it encoded.
    if (!pages.has(uri)) pages.set(uri, loadPage(pc, app.graphicsDevice, folder + encodeURIComponent(uri)));
  }
  for (const [uri, page] of pages) pages.set(uri, await page);

  // Instances share a material but have different rectangles, so each gets a copy.
  const materials = new Map();
  let meshes = 0;
  for (const { render, place } of lit) {
    for (const instance of render.meshInstances) {
      const key = [instance.material.id, place.ktx2.uri, ...place.offset, ...place.scale].join(' ');
      if (!materials.has(key)) {
        materials.set(key, placed(pc, instance.material, pages.get(place.ktx2.uri), place));
      }
      instance.material = materials.get(key);
      meshes += 1;
    }
  }
  if (!keepLights) for (const light of entity.findComponents('light')) light.enabled = false;
  const exposure = options.exposure ?? lit[0]?.place.exposure ?? 1;
  app.scene.exposure = exposure;
  return { meshes, pages: [...pages.values()], exposure };
}

function placed(pc, from, page, { offset: [u, v], scale: [w, h], texCoord }) {
  const material = from.clone();
  material.lightMap = page;
  material.lightMapUv = texCoord;
  material.lightMapTiling = new pc.Vec2(w, h);
  // PlayCanvas measures the offset from the bottom.
  material.lightMapOffset = new pc.Vec2(u, 1 - v - h);
  material.update();
  return material;
}

async function loadPage(pc, device, url) {
  const { width, height, format, data } = await fetchKtx2(url);
  if (format === 'bc6h' && !device.isWebGPU && !device.extTextureCompressionBPTC) {
    throw new Error('this graphics card has no BC6H: bake with --ktx2 rgb9e5');
  }
  return new pc.Texture(device, {
    name: url,
    width,
    height,
    format: format === 'bc6h' ? pc.PIXELFORMAT_BC6UF : pc.PIXELFORMAT_RGB9E5,
    levels: [data],
    // The charts' padding is too narrow for mip levels, and filtering must not wrap around the page's border.
    mipmaps: false,
    minFilter: pc.FILTER_LINEAR,
    magFilter: pc.FILTER_LINEAR,
    addressU: pc.ADDRESS_CLAMP_TO_EDGE,
    addressV: pc.ADDRESS_CLAMP_TO_EDGE,
  });
}
