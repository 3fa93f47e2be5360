import type { Light, LightProbe, Object3D, Vector3 } from 'three';

/** `level.probes.json` of `lumel bake --probes`. */
export interface Probes {
  version: 1;
  grid?: { origin: [number, number, number]; spacing: [number, number, number]; dims: [number, number, number] };
  probes: { position: [number, number, number]; valid: boolean; backfaces: number; error: number; sh: [number, number, number][] }[];
}

export function loadProbes(url: string): Promise<Probes>;
/** The probe with this number, or the valid one nearest to a place. */
export function lightProbe(probes: Probes, at: number | Vector3, exposure?: number): LightProbe;
/** A `LightProbeGridWebGL` of three.js. */
export function probeGrid(probes: Probes, exposure?: number): Promise<Light>;
/** Keeps the light of probes off materials with a lightmap. */
export function ignoreProbes(root: Object3D): void;
