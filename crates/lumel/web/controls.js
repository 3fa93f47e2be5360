// Orbit and walk controls.
import { Euler, Vector3 } from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';

const MOVES = {
  KeyW: [0, 0, -1], KeyS: [0, 0, 1], KeyA: [-1, 0, 0], KeyD: [1, 0, 0],
  ArrowUp: [0, 0, -1], ArrowDown: [0, 0, 1], ArrowLeft: [-1, 0, 0], ArrowRight: [1, 0, 0],
  Space: [0, 1, 0], KeyC: [0, -1, 0],
};

/** Radians per pixel while looking around. */
const TURN = 0.004;

export class Controls {
  constructor(stage, onChange) {
    Object.assign(this, { stage, onChange, mode: 'orbit', held: new Set(), fast: false, speed: 1 });
    this.orbit = new OrbitControls(stage.camera, stage.canvas);
    this.orbit.enableDamping = false;
    this.orbit.zoomToCursor = true;
    this.orbit.addEventListener('change', () => this.moved());
    const { canvas } = stage;
    canvas.addEventListener('pointerdown', (e) => {
      canvas.focus();
      if (this.mode === 'walk') canvas.setPointerCapture(e.pointerId);
    });
    canvas.addEventListener('pointermove', (e) => {
      if (this.mode === 'walk' && e.buttons !== 0) this.turn(e.movementX, e.movementY);
    });
    // A window that loses focus gets no keyup events.
    window.addEventListener('blur', () => this.held.clear());
  }

  /** The centre of orbits. */
  get target() {
    return this.orbit.target;
  }

  setMode(mode) {
    this.mode = mode;
    this.orbit.enabled = mode === 'orbit';
    if (mode === 'orbit') {
      // Orbiting continues from the walk's position, about a point straight ahead.
      const ahead = new Vector3(0, 0, -1).applyQuaternion(this.stage.camera.quaternion);
      const distance = Math.min(this.target.distanceTo(this.stage.camera.position), 0.3 * this.stage.extent);
      this.lookAt(this.stage.camera.position.clone().addScaledVector(ahead, distance || 1));
    }
    this.held.clear();
  }

  /** Makes `point` the centre of orbits. */
  lookAt(point) {
    this.target.copy(point);
    this.orbit.minDistance = 1e-4 * this.stage.extent;
    this.orbit.maxDistance = 10 * this.stage.extent;
    if (this.mode === 'orbit') this.orbit.update();
    this.moved();
  }

  moved() {
    this.stage.clip();
    this.onChange();
  }

  turn(dx, dy) {
    const { camera } = this.stage;
    const angles = new Euler().setFromQuaternion(camera.quaternion, 'YXZ');
    angles.y -= dx * TURN;
    angles.x = Math.max(-1.55, Math.min(1.55, angles.x - dy * TURN));
    angles.z = 0;
    camera.quaternion.setFromEuler(angles);
    this.moved();
  }

  /** Handles a key of the walk mode; false for other keys. */
  key(event, down) {
    this.fast = event.shiftKey;
    if (this.mode !== 'walk' || !(event.code in MOVES)) return false;
    if (down) this.held.add(event.code);
    else this.held.delete(event.code);
    return true;
  }

  /** Moves the camera for a frame of `seconds`. */
  step(seconds) {
    if (this.mode !== 'walk' || this.held.size === 0) return;
    const { camera } = this.stage;
    const way = new Vector3();
    let rise = 0;
    for (const code of this.held) {
      const [x, y, z] = MOVES[code];
      way.add(new Vector3(x, 0, z));
      rise += y;
    }
    // Crossing a level of 30 m takes about ten seconds.
    const length = 0.06 * this.stage.extent * this.speed * (this.fast ? 4 : 1) * Math.min(seconds, 0.1);
    camera.position.addScaledVector(way.applyQuaternion(camera.quaternion).normalize(), way.lengthSq() > 0 ? length : 0);
    camera.position.y += Math.sign(rise) * length;
    this.moved();
  }
}
