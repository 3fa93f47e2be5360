// Surface shading: three.js's Lambertian material with our own lightmap lookup. A uniform chooses
// what is shown, so views never need another program.
import { DoubleSide, Vector2, Vector3, Vector4 } from 'three';
import { diffuseMaterial } from './lumel-lightmap.js';

/** Values of the uniform `lumelView`. */
export const VIEW = { lit: 0, white: 1, albedo: 2, error: 3, share: 4, direction: 5, outgoing: 6 };

/** Relative errors at the ends of the colour scale, as in `lumel diff --picture`. */
export const ERROR_RANGE = [0.001, 1];

/** sRGB stops of that scale. */
export const HEAT = [[0, 0, 0], [40, 40, 180], [20, 150, 140], [220, 200, 30], [255, 90, 30], [255, 255, 255]];

/** Uniforms shared by all surfaces. */
export function sharedUniforms() {
  return {
    lumelView: { value: VIEW.lit },
    lumelExposure: { value: 1 },
    // 0 shows values unchanged and clipped.
    lumelWhitePoint: { value: 0 },
    lumelGrid: { value: 0 },
    lumelTexels: { value: 0 },
    lumelGlow: { value: 1 },
    lumelFactor: { value: 1 },
    lumelOutgoing: { value: 0 },
    // Light of surfaces without a lightmap.
    lumelEven: { value: new Vector3() },
  };
}

/** Uniforms of one page. */
export function pageUniforms(width, height) {
  return {
    lumelLight: { value: null },
    // Data that a view shows besides the light: error, coverage, …
    lumelData: { value: null },
    // The total light, to which errors are relative.
    lumelAll: { value: null },
    lumelSize: { value: new Vector2(width, height) },
  };
}

const VERTEX = `
#ifdef LUMEL_PAGE
  uniform vec4 lumelPlace;
  varying vec2 vLumel;
#endif
void main() {
#ifdef LUMEL_PAGE
  vLumel = lumelPlace.xy + lumelPlace.zw * uv1;
#endif
`;

const heatColor = HEAT.map((c) => `vec3(${c.map((x) => (x / 255).toFixed(4)).join(', ')})`);

const FRAGMENT_HEAD = `
uniform int lumelView;
uniform float lumelExposure, lumelWhitePoint, lumelGrid, lumelTexels, lumelGlow, lumelFactor, lumelOutgoing;
uniform vec3 lumelEven;
#ifdef LUMEL_PAGE
  uniform sampler2D lumelLight, lumelData, lumelAll;
  uniform vec2 lumelSize;
  varying vec2 vLumel;
  vec3 lumelLook(sampler2D plane) {
    vec2 at = lumelTexels > 0.5 ? (floor(vLumel * lumelSize) + 0.5) / lumelSize : vLumel;
    return texture2D(plane, at).rgb;
  }
#endif
vec3 lumelDecode(vec3 c) {
  return mix(pow((c + 0.055) / 1.055, vec3(2.4)), c / 12.92, vec3(lessThanEqual(c, vec3(0.04045))));
}
vec3 lumelHeat(float t) {
  vec3 stops[6] = vec3[6](${heatColor.join(', ')});
  float s = clamp(t, 0.0, 1.0) * 5.0;
  int i = min(int(s), 4);
  return lumelDecode(mix(stops[i], stops[i + 1], s - float(i)));
}
vec3 lumelTone(vec3 c) {
  c = max(c, vec3(0.0)) * lumelExposure;
  if (lumelWhitePoint <= 0.0) return c;
  return c * (1.0 + c / (lumelWhitePoint * lumelWhitePoint)) / (1.0 + c);
}
void main() {
`;

const FRAGMENT_TAIL = `
  vec3 lumelAlbedo = diffuseColor.rgb;
  vec3 lumelGlowing = totalEmissiveRadiance * lumelGlow;
#ifdef LUMEL_PAGE
  vec3 lumelStored = lumelLook(lumelLight) * lumelFactor;
  if (lumelView == ${VIEW.lit}) {
    outgoingLight = lumelTone(lumelStored * mix(lumelAlbedo, vec3(1.0), lumelOutgoing) + lumelGlowing);
  } else if (lumelView == ${VIEW.white}) {
    outgoingLight = lumelTone(lumelStored);
  } else if (lumelView == ${VIEW.outgoing}) {
    outgoingLight = lumelTone(lumelLook(lumelData) * lumelFactor);
  } else if (lumelView == ${VIEW.error}) {
    vec3 weights = vec3(0.2126, 0.7152, 0.0722);
    float relative = lumelLook(lumelData).g / max(dot(lumelLook(lumelAll), weights), 1e-20);
    float decades = log(${(ERROR_RANGE[1] / ERROR_RANGE[0]).toFixed(1)});
    outgoingLight = lumelHeat(log(max(relative, 1e-20) / ${ERROR_RANGE[0]}) / decades);
  } else if (lumelView == ${VIEW.share}) {
    outgoingLight = lumelDecode(clamp(lumelLook(lumelData), 0.0, 1.0));
  } else if (lumelView == ${VIEW.direction}) {
    outgoingLight = lumelDecode(0.5 + 0.5 * clamp(lumelLook(lumelData), -1.0, 1.0));
  } else {
    outgoingLight = lumelAlbedo;
  }
  if (lumelGrid > 0.5) {
    vec2 cell = vLumel * lumelSize;
    vec2 wide = fwidth(cell);
    // Squares below two pixels would flicker.
    float seen = 1.0 - smoothstep(0.25, 0.5, max(wide.x, wide.y));
    float odd = mod(floor(cell.x) + floor(cell.y), 2.0);
    outgoingLight = mix(outgoingLight, outgoingLight * 0.45 + vec3(0.02, 0.05, 0.1), odd * seen);
  }
#else
  if (lumelView == ${VIEW.lit}) outgoingLight = lumelTone(lumelAlbedo * lumelEven + lumelGlowing);
  else if (lumelView == ${VIEW.albedo}) outgoingLight = lumelAlbedo;
  else outgoingLight = vec3(0.05);
#endif
  #include <opaque_fragment>
`;

/**
 * A material that shows `original` lit by its page, or uniformly lit if `page` is missing.
 *
 * @param {object} shared From `sharedUniforms`.
 * @param {object} [page] From `pageUniforms`.
 * @param {object} [place] Rectangle in the page: `offset` and `scale`.
 */
export function bakedMaterial(original, shared, page, place) {
  const material = diffuseMaterial(original);
  const uniforms = { ...shared, ...page };
  if (page) {
    material.defines = { LUMEL_PAGE: '', USE_UV1: '' };
    uniforms.lumelPlace = { value: new Vector4(...place.offset, ...place.scale) };
  }
  material.onBeforeCompile = (shader) => {
    Object.assign(shader.uniforms, uniforms);
    shader.vertexShader = shader.vertexShader.replace('void main() {', VERTEX);
    shader.fragmentShader = shader.fragmentShader
      .replace('void main() {', FRAGMENT_HEAD)
      .replace('#include <opaque_fragment>', FRAGMENT_TAIL);
  };
  // The source is the same for all pages, so three.js may share programs.
  material.customProgramCacheKey = () => (page ? 'lumel page' : 'lumel even');
  if (material.side === DoubleSide) material.forceSinglePass = true;
  return material;
}
