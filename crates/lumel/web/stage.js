// The level on the canvas: loads the glTF, assigns pages to surfaces, redraws after changes.
import {
  Box3, Color, LinearSRGBColorSpace, LoadingManager, NoToneMapping, PerspectiveCamera, Raycaster, Scene, SRGBColorSpace, Texture, Vector3, WebGLRenderer,
} from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { findPlacements, removeLights } from './lumel-lightmap.js';
import { bakedMaterial, pageUniforms, sharedUniforms } from './shading.js';

/** KTX2 textures are shown white, because a decoder takes half a megabyte. */
const noKtx2 = { load: (url, done) => done(new Texture()), loadAsync: async () => new Texture(), setPath() {}, detectSupport() {} };

/** Index of the interior view of a level without cameras; other views without a camera are from outside. */
export const INSIDE = -2;

export class Stage {
  constructor(canvas) {
    this.canvas = canvas;
    this.renderer = new WebGLRenderer({ canvas, antialias: true });
    this.renderer.outputColorSpace = SRGBColorSpace;
    // The surface shader tone-maps, so that false colours stay exact.
    this.renderer.toneMapping = NoToneMapping;
    this.scene = new Scene();
    this.scene.background = new Color().setRGB(0.022, 0.027, 0.038, LinearSRGBColorSpace);
    this.camera = new PerspectiveCamera(60, 1, 0.05, 1000);
    this.scene.add(this.camera);
    this.shared = sharedUniforms();
    this.pages = [];
    this.box = new Box3();
    this.dirty = true;
  }

  /** Loads a bake's glTF in place of the current one. Returns how many meshes have and lack a lightmap. */
  async load(bake) {
    const manager = new LoadingManager();
    const loader = new GLTFLoader(manager).setKTX2Loader(noKtx2);
    const gltf = await loader.loadAsync(bake.sceneUrl);
    this.clear();
    this.bake = bake;
    this.root = gltf.scene;
    removeLights(this.root);
    this.pages = bake.manifest.pages.map((p) => pageUniforms(p.width, p.height));
    this.shared.lumelFactor.value = bake.factor;
    this.shared.lumelOutgoing.value = bake.outgoing ? 1 : 0;

    const placements = new Map(findPlacements(gltf, bake.manifest).map((p) => [p.mesh, p]));
    this.places = placements;
    this.unbaked = [];
    const materials = new Map();
    this.root.traverse((object) => {
      if (!object.isMesh) {
        // Points and lines have no light.
        if (object.isLine || object.isPoints) object.visible = false;
        return;
      }
      const place = placements.get(object)?.place;
      const page = place && this.pages[place.page];
      if (!page) this.unbaked.push(object);
      const wear = (material) => {
        const key = [material.uuid, ...(page ? [place.page, ...place.offset, ...place.scale] : [])].join(' ');
        if (!materials.has(key)) materials.set(key, bakedMaterial(material, this.shared, page, place));
        return materials.get(key);
      };
      object.material = Array.isArray(object.material) ? object.material.map(wear) : wear(object.material);
      object.userData.lumelNode = placements.get(object)?.node.name ?? object.name;
    });
    this.materials = [...materials.values()];
    this.scene.add(this.root);
    this.root.updateMatrixWorld(true);
    this.box.setFromObject(this.root);
    this.cameras = gltf.cameras.filter((c) => c.isPerspectiveCamera);
    this.room = this.cameras.length > 0 ? undefined : this.findRoom();
    this.invalidate();
    return { baked: placements.size, unbaked: this.unbaked.length };
  }

  clear() {
    if (!this.root) return;
    this.root.traverse((object) => object.geometry?.dispose());
    for (const material of this.materials) {
      for (const value of Object.values(material)) if (value?.isTexture) value.dispose();
      material.dispose();
    }
    this.scene.remove(this.root);
    this.root = undefined;
  }

  /** Size of the level, metres; never 0. */
  get extent() {
    return this.box.isEmpty() ? 1 : Math.max(this.box.getSize(new Vector3()).length(), 1e-3);
  }

  /**
   * A viewpoint in a level without cameras: at one end of the room around its centre, or in front of
   * its open side. Returns eye and target, or nothing if there are no walls around the centre.
   */
  findRoom() {
    if (this.box.isEmpty()) return undefined;
    const center = this.box.getCenter(new Vector3());
    const far = (x, y, z) => {
      const ray = new Raycaster(center, new Vector3(x, y, z));
      return ray.intersectObject(this.root, true).find((hit) => hit.object.isMesh)?.distance ?? Infinity;
    };
    const sides = [[1, 0, 0], [-1, 0, 0], [0, 0, 1], [0, 0, -1]].map((d) => ({ to: new Vector3(...d), free: far(...d) }));
    const open = sides.filter((s) => s.free === Infinity);
    if (open.length > 1 || far(0, -1, 0) === Infinity) return undefined;
    if (open.length === 1) return { center, before: open[0].to };
    const longest = sides.reduce((a, b) => (b.free > a.free ? b : a));
    const behind = sides.find((s) => s.to.dot(longest.to) < -0.5).free;
    const eye = center.clone().addScaledVector(longest.to, -0.85 * behind);
    return { center, eye, ahead: longest.to };
  }

  /** Looks from a camera of the file, from inside, or at the whole level. Returns the centre of orbits. */
  lookFrom(index) {
    const from = this.cameras[index];
    const center = this.box.isEmpty() ? new Vector3() : this.box.getCenter(new Vector3());
    if (from) {
      from.updateWorldMatrix(true, false);
      from.matrixWorld.decompose(this.camera.position, this.camera.quaternion, new Vector3());
      this.camera.fov = from.fov;
      const ahead = new Vector3(0, 0, -1).applyQuaternion(this.camera.quaternion);
      const distance = Math.min(Math.max(center.distanceTo(this.camera.position), 0.05 * this.extent), 0.3 * this.extent);
      center.copy(this.camera.position).addScaledVector(ahead, distance);
    } else if (index === INSIDE && this.room?.eye) {
      this.camera.fov = 70;
      this.camera.position.copy(this.room.eye);
      center.copy(this.room.eye).addScaledVector(this.room.ahead, 0.3 * this.extent);
      this.camera.lookAt(center);
    } else if (index === INSIDE && this.room) {
      this.camera.fov = 45;
      this.frame(center, this.room.before);
    } else {
      this.camera.fov = 60;
      this.frame(center, new Vector3(0.45, 0.4, 0.6).normalize());
    }
    this.clip();
    return center;
  }

  /** Looks at `center` from the direction `from`, at the distance where the whole level fits the canvas. */
  frame(center, from) {
    this.resize();
    const { camera } = this;
    camera.position.copy(center).add(from);
    camera.lookAt(center);
    const up = Math.tan((camera.fov * Math.PI) / 360);
    const side = up * camera.aspect;
    const turn = camera.quaternion.clone().invert();
    let distance = 0;
    for (let corner = 0; corner < 8 && !this.box.isEmpty(); corner++) {
      const at = new Vector3(...['x', 'y', 'z'].map((k, i) => this.box[corner & (1 << i) ? 'max' : 'min'][k]));
      at.sub(center).applyQuaternion(turn);
      distance = Math.max(distance, at.z + Math.abs(at.x) / side, at.z + Math.abs(at.y) / up);
    }
    // With a margin of 5 %.
    camera.position.copy(center).addScaledVector(from, 1.05 * distance || 1);
  }

  /** Sets near and far planes for the camera's position. */
  clip() {
    const away = this.box.isEmpty() ? 0 : this.box.distanceToPoint(this.camera.position);
    this.camera.near = Math.max(1e-4 * this.extent, 0.3 * away);
    this.camera.far = away + 2 * this.extent;
    this.camera.updateProjectionMatrix();
    this.invalidate();
  }

  invalidate() {
    this.dirty = true;
  }

  /** Resizes the canvas to its place on the page. */
  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    if (width === 0 || height === 0) return;
    const ratio = Math.min(window.devicePixelRatio, 2);
    if (this.width === width && this.height === height && this.ratio === ratio) return;
    Object.assign(this, { width, height, ratio });
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.invalidate();
  }

  /** Draws if something changed. */
  draw() {
    this.resize();
    if (!this.dirty || !this.root) return false;
    this.dirty = false;
    this.renderer.render(this.scene, this.camera);
    return true;
  }
}
