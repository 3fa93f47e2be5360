import type { ReactElement } from 'react';
import type { ThreeElements } from '@react-three/fiber';
import type { GLTF } from 'three/addons/loaders/GLTFLoader.js';
import type { LightmapOptions } from './lumel-lightmap.js';

/** Options with plain values. */
export type LevelOptions = Pick<LightmapOptions, 'path' | 'ktx2' | 'exposure' | 'diffuse' | 'keepLights'>;

/** A level with its lightmaps; suspends until both are loaded. */
export function useLumelLevel(url: string, options?: LevelOptions): GLTF;
export namespace useLumelLevel {
  /** Starts loading a level before a component needs it. */
  function preload(url: string, options?: LevelOptions): void;
}

/** The level as an object in the scene. */
export function LumelLevel(
  props: { url: string } & LevelOptions & Omit<ThreeElements['primitive'], 'object'>,
): ReactElement;
