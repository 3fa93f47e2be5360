/**
 * `MOZ_lightmap` for three.js's GLTFLoader, for files from `lumel bake --ext moz` or the Hubs exporter. Tested with r187.
 *
 *     import { HDRLoader } from 'three/addons/loaders/HDRLoader.js';
 *     import { MozLightmap, MozTextureRgbe } from './moz-lightmap.js';
 *
 *     const loader = new GLTFLoader();
 *     loader.register((parser) => new MozTextureRgbe(parser, new HDRLoader()));      // without it: the PNG, 8 bits per channel
 *     loader.register((parser) => new MozLightmap(parser));
 *
 * The extension's texture contains irradiance divided by `intensity`, as three.js expects of a light map.
 */
import { LinearFilter, LinearSRGBColorSpace } from 'three';

/** Light maps of materials. */
export class MozLightmap {
  constructor(parser) {
    this.name = 'MOZ_lightmap';
    this.parser = parser;
  }

  /** GLTFLoader uses the first result that is not null, and a promise never is, so this must not be async. */
  loadMaterial(index) {
    const extension = this.parser.json.materials[index].extensions?.[this.name];
    return extension ? this.lit(index, extension) : null;
  }

  async lit(index, extension) {
    const [material, texture] = await Promise.all([
      this.parser.loadMaterial(index),
      this.parser.getDependency('texture', extension.index),
    ]);
    // Another texture slot may use the same texture.
    const lightMap = texture.clone();
    lightMap.channel = extension.texCoord ?? 1;
    lightMap.colorSpace = LinearSRGBColorSpace;
    lightMap.minFilter = lightMap.magFilter = LinearFilter;
    lightMap.generateMipmaps = false;
    lightMap.needsUpdate = true;
    material.lightMap = lightMap;
    material.lightMapIntensity = extension.intensity ?? 1;
    return material;
  }
}

/** Radiance RGBE pictures. */
export class MozTextureRgbe {
  constructor(parser, loader) {
    this.name = 'MOZ_texture_rgbe';
    this.parser = parser;
    this.loader = loader;
  }

  loadTexture(index) {
    const extension = this.parser.json.textures[index].extensions?.[this.name];
    return extension ? this.parser.loadTextureImage(index, extension.source, this.loader) : null;
  }
}
