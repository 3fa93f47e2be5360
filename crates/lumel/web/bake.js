// What the server knows about a bake, and its planes of texels.
import { ClampToEdgeWrapping, DataTexture, DataUtils, HalfFloatType, LinearFilter, LinearSRGBColorSpace, RGBAFormat } from 'three';

/** Optional layers in the panel's order: channel name, title, kind, and the option that writes it. */
export const LAYERS = [
  { name: 'direct', title: 'Direct', kind: 'light', option: '--layers direct' },
  { name: 'indirect', title: 'Indirect', kind: 'light', option: '--layers indirect' },
  { name: 'error', title: 'Error', kind: 'error', option: '--layers error' },
  { name: 'coverage', title: 'Coverage', kind: 'share', option: '--layers coverage' },
  { name: 'ao', title: 'Openness', kind: 'share', option: '--layers ao' },
  { name: 'sun_mask', title: 'Sun mask', kind: 'share', option: '--layers sun_mask' },
  { name: 'radiosity', title: 'Reflected', kind: 'outgoing', option: '--layers radiosity' },
  { name: 'dominant', title: 'Direction', kind: 'direction', option: '--directional dominant' },
  { name: 'L0', title: 'SH L0', kind: 'outgoing', option: '--directional sh1' },
];

export async function listBakes() {
  return (await ask('/api/bakes')).json();
}

async function ask(url) {
  const response = await fetch(url);
  if (!response.ok) throw new Error((await response.text()) || `${url}: ${response.status}`);
  return response;
}

/** A finished bake: manifest, report, and textures loaded on demand. */
export class Bake {
  static async open(name) {
    const query = `bake=${encodeURIComponent(name)}`;
    const manifest = await (await ask(`/api/manifest?${query}`)).json();
    // A bake without a report can still be shown.
    const report = await ask(`/api/report?${query}`).then((r) => r.json(), () => undefined);
    return new Bake(name, manifest, report);
  }

  constructor(name, manifest, report) {
    Object.assign(this, { name, manifest, report, planes: new Map() });
    this.layers = new Set((manifest.channels ?? []).map((c) => c.slice(0, c.lastIndexOf('.'))));
    this.groups = (manifest.groups ?? []).map((g) => g.name);
    // Factor from the stored value to the radiance of a white surface (of the surface itself if the
    // lightmap holds radiosity).
    this.outgoing = manifest.value === 'radiosity';
    this.factor = manifest.value === 'radiance' ? 1 : 1 / Math.PI;
  }

  get sceneUrl() {
    return `/files/${encodeURIComponent(this.manifest.scene)}`;
  }

  /** A layer ('' for the light) of a page, optionally of a group: a half-float texture, row 0 at v = 0. */
  plane(page, layer = '', group = undefined) {
    const key = JSON.stringify([page, layer, group]);
    if (!this.planes.has(key)) this.planes.set(key, this.load(page, layer, group));
    return this.planes.get(key);
  }

  async load(page, layer, group) {
    const query = new URLSearchParams({ bake: this.name, page, layer });
    if (group !== undefined) query.set('group', group);
    const response = await ask(`/api/plane?${query}`);
    const [width, height] = ['X-Width', 'X-Height'].map((h) => Number(response.headers.get(h)));
    const data = new Uint16Array(await response.arrayBuffer());
    const texture = new DataTexture(data, width, height, RGBAFormat, HalfFloatType);
    texture.wrapS = texture.wrapT = ClampToEdgeWrapping;
    texture.minFilter = texture.magFilter = LinearFilter;
    texture.colorSpace = LinearSRGBColorSpace;
    texture.needsUpdate = true;
    return texture;
  }

  dispose() {
    for (const plane of this.planes.values()) plane.then((t) => t.dispose(), () => {});
    this.planes.clear();
  }
}

/** RGB of a texel of a plane. */
export function texel(plane, x, y) {
  const { data, width } = plane.image;
  return [0, 1, 2].map((c) => DataUtils.fromHalfFloat(data[4 * (y * width + x) + c]));
}

export function luminance([r, g, b]) {
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}

/**
 * Exposure, white point and mean of the light. The exposure is the one that the bake suggests, so
 * that the page looks like engines do. Bakes before 0.2 suggest none; theirs is measured by the same
 * rule: the log-average of the middle 90 % becomes middle grey (Reinhard et al. 2002). The 99th
 * percentile becomes white.
 */
export function measure(planes, factor, suggested) {
  const samples = [];
  for (const plane of planes) {
    const { width, height } = plane.image;
    const step = Math.max(1, Math.floor(Math.sqrt((width * height) / 20000)));
    for (let y = 0; y < height; y += step) {
      for (let x = 0; x < width; x += step) {
        const l = factor * luminance(texel(plane, x, y));
        if (l > 0 && Number.isFinite(l)) samples.push(l);
      }
    }
  }
  if (samples.length === 0) return { exposure: 1, white: 1, mean: 0 };
  samples.sort((a, b) => a - b);
  const at = (q) => samples[Math.floor((samples.length - 1) * q)];
  const exposure = suggested ?? measuredExposure(samples, at(0.9) * 1e-3);
  const mean = samples.reduce((a, b) => a + b, 0) / samples.length;
  return { exposure, white: Math.min(16, Math.max(0.3, at(0.99) * exposure * 0.5)), mean };
}

function measuredExposure(sorted, floor) {
  const cut = Math.floor(sorted.length / 20);
  const middle = sorted.slice(cut, Math.max(sorted.length - cut, cut + 1));
  const log = middle.reduce((sum, l) => sum + Math.log(Math.max(l, floor)), 0) / middle.length;
  // Twice the exposure, because typical albedos are about a half.
  return (0.18 / Math.exp(log)) * 2;
}
