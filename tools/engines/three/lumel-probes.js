/**
 * Lumel's light probes in three.js (tested with r187, WebGLRenderer).
 *
 *     import { ignoreProbes, loadProbes, probeGrid } from './lumel-probes.js';
 *
 *     const { exposure } = await attachLightmaps(gltf);
 *     const probes = await loadProbes('out/level.probes.json');
 *     scene.add(await probeGrid(probes, exposure));
 *     ignoreProbes(gltf.scene);
 *
 * The file holds radiances in the spherical harmonics that three.js uses, in the same order.
 */
import { Data3DTexture, DataUtils, HalfFloatType, LightProbe, LinearFilter, RGBAFormat, ShaderChunk, Vector3 } from 'three';

/** Fetches `level.probes.json`. */
export async function loadProbes(url) {
  const response = await fetch(url);
  if (!response.ok) throw new Error(`${url}: ${response.status} ${response.statusText}`);
  const probes = await response.json();
  if (probes.version !== 1 || !Array.isArray(probes.probes)) throw new Error(`${url} is no file of probes that lumel bake wrote`);
  return probes;
}

/**
 * A LightProbe of three.js, which lights everything in its scene.
 *
 * @param {object} probes The file.
 * @param {number | Vector3} at A probe's number, or a place in the level: the nearest valid probe.
 * @param {number} [exposure] As `attachLightmaps` returns it.
 */
export function lightProbe(probes, at, exposure = 1) {
  const probe = typeof at === 'number' ? probes.probes[at] : nearest(probes, at);
  if (!probe) throw new Error(`no probe ${at}`);
  const light = new LightProbe(undefined, exposure);
  light.sh.fromArray(probe.sh.flat());
  light.position.fromArray(probe.position);
  return light;
}

function nearest({ probes }, at) {
  const place = new Vector3();
  const far = (probe) => place.fromArray(probe.position).distanceToSquared(at);
  return probes.filter((probe) => probe.valid).reduce((a, b) => (a && far(a) <= far(b) ? a : b), undefined);
}

/**
 * A LightProbeGrid of three.js, which lights what is inside it by the probes around each point. Its parent must be the scene or have no
 * transform: grids are aligned with the world.
 *
 * @param {object} probes A file with a grid (`--probes SPACING`).
 * @param {number} [exposure] As `attachLightmaps` returns it. It is in the texture, because three.js ignores a grid's intensity.
 */
export async function probeGrid(probes, exposure = 1) {
  if (!probes.grid) throw new Error('these probes are no grid: bake with --probes SPACING');
  const { LightProbeGridWebGL } = await import('three/addons/lighting/LightProbeGridWebGL.js');
  const { origin, spacing, dims } = probes.grid;
  // Each probe is in the middle of its cell. A shell of copies surrounds the bake's grid: three.js looks half a cell in front of a surface,
  // and shows black where that is outside, as below a ball on the floor.
  const shell = dims.map((n) => n + 2);
  const size = shell.map((n, i) => n * spacing[i]);
  const grid = new LightProbeGridWebGL(...size, ...shell);
  grid.position.fromArray(origin.map((o, i) => o + 0.5 * (dims[i] - 1) * spacing[i]));
  grid.updateBoundingBox();
  grid.texture = gridTexture(probes, exposure);
  return grid;
}

/**
 * The texture as the shader of r187 reads it: the 27 numbers of a probe are seven RGBA volumes, one after the other along z. Each repeats
 * its first and last slice, so that filtering does not mix volumes. Halves, because not every phone filters floats.
 */
function gridTexture({ grid, probes }, exposure) {
  const [nx, ny, nz] = grid.dims.map((n) => n + 2);
  // The number of the probe at a place in the shell.
  const inner = (i, axis) => Math.min(Math.max(i - 1, 0), grid.dims[axis] - 1);
  const number = (i, j, k) => inner(i, 0) + grid.dims[0] * (inner(j, 1) + grid.dims[1] * inner(k, 2));
  const data = new Uint16Array(4 * nx * ny * 7 * (nz + 2));
  let at = 0;
  for (let volume = 0; volume < 7; volume++) {
    for (let slice = -1; slice <= nz; slice++) {
      const k = Math.min(Math.max(slice, 0), nz - 1);
      for (let i = 0; i < nx * ny; i++) {
        const numbers = probes[number(i % nx, Math.floor(i / nx), k)].sh.flat();
        for (let c = 0; c < 4; c++) data[at++] = DataUtils.toHalfFloat(exposure * (numbers[4 * volume + c] ?? 0));
      }
    }
  }
  const texture = new Data3DTexture(data, nx, ny, 7 * (nz + 2));
  texture.format = RGBAFormat;
  texture.type = HalfFloatType;
  texture.minFilter = texture.magFilter = LinearFilter;
  texture.needsUpdate = true;
  return texture;
}

/** Keeps the light of probes off materials with a lightmap, which already have it. Call it after `attachLightmaps`. */
export function ignoreProbes(root) {
  const baked = new Set();
  root.traverse((object) => {
    for (const material of [object.material ?? []].flat()) if (material.lightMap) baked.add(material);
  });
  const cuts = [['#if defined( USE_LIGHT_PROBES )', '#if 0'], ['#if NUM_LIGHT_PROBE_GRIDS > 0', '#if 0']];
  for (const material of baked) changeChunk(material, 'lights_fragment_begin', cuts, 'lumel-no-probes');
}

/** Replaces text in a chunk of a material's fragment shader, after changes that it already has. */
export function changeChunk(material, chunk, changes, name) {
  const [compile, key] = [material.onBeforeCompile, material.customProgramCacheKey()];
  material.onBeforeCompile = function (shader, renderer) {
    compile.call(this, shader, renderer);
    let code = shader.fragmentShader.replace(`#include <${chunk}>`, ShaderChunk[chunk]);
    for (const [from, to] of changes) {
      if (!code.includes(from)) throw new Error(`this version of three.js has another ${chunk}`);
      code = code.replace(from, to);
    }
    shader.fragmentShader = code;
  };
  material.customProgramCacheKey = () => `${key} ${name}`;
  material.needsUpdate = true;
}
