import type { ReactElement } from 'react';
import type { ThreeElements } from '@react-three/fiber';
import type { GLTF } from 'three/addons/loaders/GLTFLoader.js';
import type { LightmapOptions } from './lumel-lightmap.js';

/** Options that are plain values. */
export type LevelOptions = Pick<LightmapOptions, 'path' | 'ktx2' | 'exposure' | 'diffuse' | 'keepLights'>;

/** A level with its lightmaps; suspends until both are there. */
export function useLumelLevel(url: string, options?: LevelOptions): GLTF;
export namespace useLumelLevel {
  /** Starts to load a level before a component asks for it. */
  function preload(url: string, options?: LevelOptions): void;
}

/** The level as an object of the scene. */
export function LumelLevel(
  props: { url: string } & LevelOptions & Omit<ThreeElements['primitive'], 'object'>,
): ReactElement;
