// The light on the pages: a plane of the bake, or groups summed on the GPU.
import {
  AddEquation, ClampToEdgeWrapping, CustomBlending, HalfFloatType, LinearFilter, Mesh, NoBlending, OneFactor, OrthographicCamera,
  PlaneGeometry, RGBAFormat, Scene, ShaderMaterial, WebGLRenderTarget,
} from 'three';

/** Sums light groups, each with a factor, into one texture per page. */
export class Mixer {
  constructor(renderer) {
    this.renderer = renderer;
    this.targets = new Map();
    this.camera = new OrthographicCamera(-1, 1, 1, -1, 0, 1);
    this.material = new ShaderMaterial({
      uniforms: { plane: { value: null }, factor: { value: 1 } },
      // uv without a flip, so row 0 of the planes becomes row 0 of the sum.
      vertexShader: 'varying vec2 at; void main() { at = uv; gl_Position = vec4(position.xy, 0.0, 1.0); }',
      fragmentShader:
        'uniform sampler2D plane; uniform float factor; varying vec2 at; void main() { gl_FragColor = vec4(texture2D(plane, at).rgb * factor, 1.0); }',
      depthTest: false,
      depthWrite: false,
      blendEquation: AddEquation,
      blendSrc: OneFactor,
      blendDst: OneFactor,
    });
    this.scene = new Scene();
    this.scene.add(new Mesh(new PlaneGeometry(2, 2), this.material));
  }

  /** The sum of `terms` ([texture, factor]) as the texture of `page`. */
  mix(page, terms) {
    const { width, height } = terms[0][0].image;
    let target = this.targets.get(page);
    if (!target) {
      target = new WebGLRenderTarget(width, height, {
        format: RGBAFormat,
        type: HalfFloatType,
        minFilter: LinearFilter,
        magFilter: LinearFilter,
        wrapS: ClampToEdgeWrapping,
        wrapT: ClampToEdgeWrapping,
        depthBuffer: false,
      });
      this.targets.set(page, target);
    }
    const before = this.renderer.getRenderTarget();
    this.renderer.setRenderTarget(target);
    const autoClear = this.renderer.autoClear;
    this.renderer.autoClear = false;
    terms.forEach(([plane, factor], i) => {
      this.material.uniforms.plane.value = plane;
      this.material.uniforms.factor.value = factor;
      // The first term overwrites, the others add.
      this.material.blending = i === 0 ? NoBlending : CustomBlending;
      this.material.needsUpdate = true;
      this.renderer.render(this.scene, this.camera);
    });
    this.renderer.autoClear = autoClear;
    this.renderer.setRenderTarget(before);
    return target.texture;
  }

  dispose() {
    for (const target of this.targets.values()) target.dispose();
    this.targets.clear();
  }
}

/** Binds the light that `state` selects, and the data of its view, to all pages. */
export async function applyLight(bake, pages, mixer, state, view) {
  await Promise.all(
    pages.map(async (uniforms, page) => {
      const all = await bake.plane(page);
      let light = all;
      if (state.light === 'groups') {
        const planes = await Promise.all(bake.groups.map((g) => bake.plane(page, '', g)));
        light = mixer.mix(page, planes.map((p, i) => [p, state.groups[bake.groups[i]] ?? 1]));
      } else if (state.light !== 'all') {
        light = await bake.plane(page, state.light);
      }
      const data = view.layer ? await bake.plane(page, view.layer) : all;
      uniforms.lumelAll.value = all;
      uniforms.lumelLight.value = light;
      uniforms.lumelData.value = data;
    }),
  );
}
