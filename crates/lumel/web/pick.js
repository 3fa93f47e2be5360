// Figures of the point under the pointer.
import { Raycaster, Vector2 } from 'three';
import { luminance, texel } from './bake.js';

/** The nearest surface at a point of the canvas. */
export function pick(stage, x, y) {
  const ray = new Raycaster();
  ray.setFromCamera(new Vector2((2 * x) / stage.width - 1, 1 - (2 * y) / stage.height), stage.camera);
  const hits = ray.intersectObject(stage.root, true);
  return hits.find((hit) => hit.object.isMesh && hit.object.visible && hit.object.material.visible !== false);
}

/** Rows of the readout for a hit: [label, text]. */
export async function describe(stage, hit) {
  const rows = [['node', hit.object.userData.lumelNode || '(no name)'], ['material', hit.object.material.name || '(no name)']];
  rows.push(['position, m', hit.point.toArray().map((x) => x.toFixed(2)).join(', ')]);
  const place = stage.places.get(hit.object)?.place;
  if (!place || !hit.uv1) {
    rows.push(['lightmap', 'none: this node is not baked']);
    return rows;
  }
  const { bake } = stage;
  const plane = await bake.plane(place.page);
  const { width, height } = plane.image;
  const [x, y] = [0, 1].map((i) => {
    const at = place.offset[i] + place.scale[i] * hit.uv1.getComponent(i);
    const size = i === 0 ? width : height;
    return Math.min(size - 1, Math.max(0, Math.floor(at * size)));
  });
  const value = texel(plane, x, y);
  const figures = (v) => v.map((c) => Number(c.toPrecision(4))).join(', ');
  rows.push(['texel', `page ${place.page}, column ${x}, row ${y}`], [stored(bake.manifest), figures(value)]);
  const scale = bake.manifest.scaleToIrradiance;
  if (scale) rows.push(['E, lx or W/m²', figures(value.map((c) => c * scale))]);
  for (const layer of ['direct', 'indirect']) {
    if (bake.layers.has(layer)) rows.push([layer, figures(texel(await bake.plane(place.page, layer), x, y))]);
  }
  if (bake.layers.has('error')) {
    const [error] = texel(await bake.plane(place.page, 'error'), x, y);
    const l = luminance(value);
    rows.push(['error', l > 0 ? `${((100 * error) / l).toPrecision(3)} %` : figures([error])]);
  }
  return rows;
}

function stored(manifest) {
  return { radiance: 'R = E/π', irradiance: 'E', radiosity: 'B' }[manifest.value] ?? manifest.value;
}
