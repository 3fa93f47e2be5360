import type { CubeTexture, Object3D, Vector3 } from 'three';
import type { GLTF } from 'three/addons/loaders/GLTFLoader.js';

export interface Reflection {
  position: Vector3;
  texture: CubeTexture;
}

export function loadReflections(gltf: GLTF, path?: string): Promise<Reflection[]>;
export function loadReflection(url: string): Promise<CubeTexture>;
/** Gives each mesh the capture nearest to its middle. */
export function useReflections(root: Object3D, reflections: Reflection[], exposure?: number): void;
