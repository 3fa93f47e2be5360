import type { Light, Material, MeshLambertMaterial, Mesh, Object3D, Texture } from 'three';
import type { GLTF, GLTFLoaderPlugin, GLTFParser } from 'three/addons/loaders/GLTFLoader.js';

/** A node's page and rectangle: `extras.lightmap` of the .glb, or a node of the manifest. */
export interface Place {
  uri: string;
  page: number;
  texCoord: number;
  offset: [number, number];
  scale: [number, number];
  scaleToIrradiance?: number;
  exposure?: number;
  ktx2?: { uri: string; format: 'bc6h' | 'rgb9e5' };
  /** The node's shadow mask, with the index of each channel's lamp in the manifest. */
  mask?: { uri: string; lamps: (number | null)[]; ktx2?: { uri: string; format: 'rgba8' } };
}

/** A lamp whose direct light is not in the lightmap: `extras.lightmapLamp` of its node. */
export interface Lamp {
  id: number;
  mode: 'mixed' | 'realtime';
  channel?: number;
}

export interface LightmapOptions {
  /** Folder of the pages. Default: the glTF's folder. */
  path?: string;
  /** `level.lightmap.json`, for files without extras. */
  manifest?: object;
  /** Load pages as KTX2 (`lumel bake --ktx2`). */
  ktx2?: boolean;
  /** Loads a page's texture from its URL. Default: EXRLoader. */
  loadPage?: (url: string) => Promise<Texture>;
  /** Textures of `loadPage` have row 0 at the top. */
  topDown?: boolean;
  /** Factor for all light of the level. Default: the exposure that the bake suggests. */
  exposure?: number;
  /** Replace materials by Lambertian ones, which show exactly albedo x R. */
  diffuse?: boolean;
  /** Keep the file's lamps. */
  keepLights?: boolean;
}

export interface Attached {
  meshes: number;
  materials: number;
  pages: Texture[];
  /** The exposure that was applied. */
  exposure: number;
}

export interface Placement {
  mesh: Mesh;
  node: Object3D;
  place: Place;
}

export function attachLightmaps(gltf: GLTF, options?: LightmapOptions): Promise<Attached>;

/** `loader.register((parser) => new LumelLightmaps(parser, options))`; the result is in `gltf.userData.lumel`. */
export class LumelLightmaps implements GLTFLoaderPlugin {
  constructor(parser: GLTFParser, options?: LightmapOptions);
  readonly name: string;
  afterRoot(gltf: GLTF): Promise<void>;
}

export function findPlacements(gltf: GLTF, manifest?: object): Placement[];
export function suggestedExposure(placements: Placement[]): number;
export function placeTexture(page: Texture, place: Place, topDown?: boolean): Texture;
export function diffuseMaterial(from: Material): MeshLambertMaterial;
/** The lamp's data from the bake; undefined for lamps whose light is in the lightmap. */
export function lampOf(light: Light): Lamp | undefined;
/** Removes lamps whose light is in the lightmap. */
export function removeLights(root: Object3D): void;
