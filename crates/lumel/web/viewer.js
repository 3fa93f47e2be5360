// The page of `lumel view`. State lives in `state` and in the URL; every change ends in `apply`.
import { Bake, listBakes, measure } from './bake.js';
import { Controls } from './controls.js';
import { Mixer, applyLight } from './light.js';
import { $, choices, element, groupSliders, legend, lightsOf, message, showMissing, showReport, viewsOf } from './panel.js';
import { describe, pick } from './pick.js';
import { INSIDE, Stage } from './stage.js';

/** Interval of polling for new bakes, milliseconds. */
const WATCH = 1000;
/** The same while a bake is running. */
const WATCH_CLOSELY = 300;

const DEFAULTS = { view: 'lit', light: 'all', tone: 'film', ev: 0, grid: 0, texels: 0, glow: 1, unbaked: 1, mode: 'orbit', panel: 1 };
const TONES = [{ name: 'film', title: 'Soft' }, { name: 'linear', title: 'Linear' }, { name: 'values', title: 'Values' }];
const state = { ...DEFAULTS, bake: undefined, cam: undefined, groups: {} };

let stage, controls, mixer, bake, stamp;
let base = { exposure: 1, white: 1, mean: 0 };
// Of several concurrent changes only the last is shown.
let turn = 0;
let applied = 0;
let opened = 0;

function readAddress() {
  const query = new URLSearchParams(location.hash.slice(1));
  for (const [key, fallback] of Object.entries(DEFAULTS)) {
    if (!query.has(key)) continue;
    const text = query.get(key);
    state[key] = typeof fallback === 'number' ? Number(text) || 0 : text;
  }
  state.bake = query.get('bake') ?? undefined;
  const numbers = (query.get('cam') ?? '').split(',').map(Number);
  state.cam = numbers.length === 7 && numbers.every(Number.isFinite) ? numbers : undefined;
  for (const pair of query.getAll('group')) {
    const at = pair.lastIndexOf(':');
    const factor = Number(pair.slice(at + 1));
    if (at > 0 && factor >= 0) state.groups[pair.slice(0, at)] = factor;
  }
}

/** Stores the state in the URL, so that a view can be reloaded or sent to a colleague. */
function writeAddress() {
  const query = new URLSearchParams();
  query.set('bake', bake.name);
  for (const [key, fallback] of Object.entries(DEFAULTS)) if (state[key] !== fallback) query.set(key, state[key]);
  for (const [name, factor] of Object.entries(state.groups)) if (factor !== 1) query.append('group', `${name}:${factor}`);
  const { camera } = stage;
  const cam = [...camera.position.toArray(), ...controls.target.toArray(), camera.fov];
  query.set('cam', cam.map((x) => Number(x.toPrecision(6))).join(','));
  // Commas and colons need no escapes in the fragment and are more readable.
  history.replaceState(null, '', `#${query.toString().replaceAll('%2C', ',').replaceAll('%3A', ':')}`);
}

let pending;
function noteAddress() {
  clearTimeout(pending);
  pending = setTimeout(writeAddress, 250);
}

/** Updates uniforms, textures and panel from the state. */
async function apply() {
  const mine = ++turn;
  const views = viewsOf(bake);
  const lights = lightsOf(bake);
  const usable = (list, name) => (list.find((x) => x.name === name && !x.missing) ?? list[0]).name;
  state.view = usable(views, state.view);
  state.light = usable(lights, state.light);
  const view = views.find((v) => v.name === state.view);

  choices($('views'), views, state.view, (name) => set({ view: name }));
  choices($('lights'), lights, state.light, chooseLight);
  choices($('tones'), TONES, state.tone, (name) => set({ tone: name }));
  choices($('modes'), [{ name: 'orbit', title: 'Orbit' }, { name: 'walk', title: 'Walk' }], state.mode, (name) => set({ mode: name }));
  $('groups').hidden = state.light !== 'groups';
  for (const key of ['grid', 'texels', 'glow', 'unbaked']) $(key).checked = Boolean(state[key]);
  $('exposure').value = state.ev;
  $('exposure-value').textContent = `${state.ev > 0 ? '+' : ''}${Number(state.ev).toFixed(1)}`;
  document.body.classList.toggle('plain', !state.panel);
  $('show-panel').hidden = Boolean(state.panel);
  legend(view);
  if (controls.mode !== state.mode) controls.setMode(state.mode);

  await applyLight(bake, stage.pages, mixer, state, view);
  if (mine !== turn) return;
  applied = mine;
  const u = stage.shared;
  u.lumelView.value = view.view;
  // Values shows them as they are at 0 stops; Soft and Linear start from the suggested exposure.
  u.lumelExposure.value = (state.tone === 'values' ? 1 : base.exposure) * 2 ** state.ev;
  u.lumelWhitePoint.value = state.tone === 'film' ? base.white * 2 ** state.ev : 0;
  u.lumelGrid.value = Number(state.grid);
  u.lumelTexels.value = Number(state.texels);
  u.lumelGlow.value = Number(state.glow);
  u.lumelEven.value.setScalar(0.5 * base.mean);
  for (const mesh of stage.unbaked) mesh.layers.set(state.unbaked ? 0 : 1);
  stage.invalidate();
  noteAddress();
}

/** Data views do not depend on the light, so choosing a light switches to a view that shows it. */
function chooseLight(name) {
  const showsLight = state.view === 'lit' || state.view === 'light';
  return set({ light: name, view: showsLight ? state.view : 'lit' });
}

function set(change) {
  Object.assign(state, change);
  return apply().catch(fail);
}

function fail(error) {
  document.body.dataset.state = 'failed';
  message(String(error.message ?? error), true);
}

/** Shows a bake; the camera stays where it is if `keep`. */
async function open(name, keep) {
  message(`Loading ${name} …`);
  const next = await Bake.open(name);
  const counts = await stage.load(next);
  bake?.dispose();
  mixer.dispose();
  bake = next;
  const planes = await Promise.all(bake.manifest.pages.map((_, page) => bake.plane(page)));
  base = measure(planes, bake.factor, bake.manifest.exposure);
  document.title = `${name} · lumel view`;
  $('title').textContent = name;
  $('unbaked-count').textContent = counts.unbaked > 0 ? `(${counts.unbaked})` : '(none)';
  $('unbaked').disabled = counts.unbaked === 0;
  groupSliders($('groups'), bake.groups, state.groups, (group, factor) => {
    state.groups[group] = factor;
    set({});
  });
  showReport(bake);
  showMissing(bake);
  $('cameras').replaceChildren(
    ...stage.cameras.map((c, i) => element('option', c.name || `camera ${i + 1}`, { value: String(i) })),
    ...(stage.room ? [element('option', stage.room.eye ? 'inside' : 'open side', { value: String(INSIDE) })] : []),
    element('option', 'outside', { value: '-1' }),
  );
  if (!keep) {
    if (state.cam) {
      const [x, y, z, tx, ty, tz, fov] = state.cam;
      stage.camera.position.set(x, y, z);
      stage.camera.fov = fov > 0 ? fov : 60;
      stage.camera.lookAt(tx, ty, tz);
      controls.target.set(tx, ty, tz);
      controls.lookAt(controls.target.clone());
      $('cameras').selectedIndex = -1;
    } else {
      firstCamera();
    }
  }
  $('readout').hidden = true;
  await apply();
  message(bake.manifest.pages.length === 0 ? 'This bake has no lightmap pages.' : '');
  document.body.dataset.state = 'ready';
  opened += 1;
}

function firstCamera() {
  $('cameras').selectedIndex = 0;
  lookFrom(Number($('cameras').value));
}

function lookFrom(index) {
  // The picked point may be out of sight now.
  $('readout').hidden = true;
  const target = stage.lookFrom(index);
  controls.target.copy(target);
  controls.lookAt(target);
}

/** Polls the bakes and reloads one that was baked again. */
async function watch() {
  try {
    const { bakes, status } = await listBakes();
    showStatus(status);
    const now = bakes.find((b) => b.name === bake?.name);
    if (now && now.stamp !== stamp) {
      await open(now.name, true);
      stamp = now.stamp;
    }
    if (document.body.dataset.state === 'lost') {
      message('');
      document.body.dataset.state = 'ready';
    }
  } catch (error) {
    // The server has ended; the loaded level can still be viewed. A file may also have been read
    // while a bake replaced it; the next poll will read it.
    if (error instanceof TypeError) {
      document.body.dataset.state = 'lost';
    }
  }
  setTimeout(watch, $('status').hidden ? WATCH : WATCH_CLOSELY);
}

/** What `lumel watch` is doing. */
function showStatus(status) {
  $('status').hidden = !status;
  $('status').textContent = status?.text ?? '';
  $('status').classList.toggle('fault', Boolean(status?.fault));
}

function listen() {
  const { canvas } = stage;
  let pressed;
  canvas.addEventListener('pointerdown', (e) => (pressed = [e.clientX, e.clientY]));
  canvas.addEventListener('click', async (e) => {
    // A click that ends a drag does not pick.
    if (!pressed || Math.hypot(e.clientX - pressed[0], e.clientY - pressed[1]) > 4) return;
    const hit = pick(stage, e.offsetX, e.offsetY);
    $('readout').hidden = !hit;
    if (!hit) return;
    const table = element('table');
    for (const [k, v] of await describe(stage, hit)) {
      const row = element('tr');
      row.append(element('td', k), element('td', v));
      table.append(row);
    }
    $('readout').replaceChildren(table);
  });
  canvas.addEventListener('dblclick', (e) => {
    const hit = pick(stage, e.offsetX, e.offsetY);
    if (hit) controls.lookAt(hit.point);
  });
  $('exposure').addEventListener('input', (e) => set({ ev: Number(e.target.value) }));
  $('auto-exposure').addEventListener('click', () => set({ ev: 0, tone: 'film' }));
  for (const key of ['grid', 'texels', 'glow', 'unbaked']) $(key).addEventListener('change', (e) => set({ [key]: Number(e.target.checked) }));
  $('cameras').addEventListener('change', (e) => lookFrom(Number(e.target.value)));
  $('speed').addEventListener('input', (e) => (controls.speed = 2 ** Number(e.target.value)));
  $('bakes').addEventListener('change', (e) => {
    state.cam = undefined;
    state.groups = {};
    stamp = undefined;
    open(e.target.value, false).then(listStamp).catch(fail);
  });
  $('hide-panel').addEventListener('click', () => set({ panel: 0 }));
  $('show-panel').addEventListener('click', () => set({ panel: 1 }));
  $('help-button').addEventListener('click', () => $('help').showModal());
  window.addEventListener('keydown', key);
  window.addEventListener('keyup', (e) => controls.key(e, false));
  new ResizeObserver(() => stage.resize()).observe(canvas.parentElement);
}

function key(e) {
  if (e.ctrlKey || e.altKey || e.metaKey || $('help').open) return;
  // Sliders and lists keep their own keys.
  const own = ['INPUT', 'SELECT', 'BUTTON'].includes(document.activeElement?.tagName) && /^(Arrow|Space|Home|End|Page)/.test(e.code);
  if (own || document.activeElement?.tagName === 'SELECT') return;
  if (controls.key(e, true)) {
    e.preventDefault();
    return;
  }
  const views = viewsOf(bake);
  const digit = /^[1-9]$/.test(e.key) ? views[Number(e.key) - 1] : undefined;
  const lights = lightsOf(bake).filter((l) => !l.missing);
  const next = lights[(lights.findIndex((l) => l.name === state.light) + 1) % lights.length];
  const actions = {
    o: () => set({ mode: 'orbit' }),
    f: () => set({ mode: 'walk' }),
    l: () => chooseLight(next.name),
    '+': () => set({ ev: Math.min(10, state.ev + 0.5) }),
    '=': () => set({ ev: Math.min(10, state.ev + 0.5) }),
    '-': () => set({ ev: Math.max(-10, state.ev - 0.5) }),
    e: () => set({ ev: 0, tone: 'film' }),
    g: () => set({ grid: Number(!state.grid) }),
    t: () => set({ texels: Number(!state.texels) }),
    r: firstCamera,
    h: () => set({ panel: Number(!state.panel) }),
    '?': () => $('help').showModal(),
  };
  if (digit) {
    if (!digit.missing) set({ view: digit.name });
  } else {
    actions[e.key.toLowerCase()]?.();
  }
}

async function listStamp() {
  const { generator, bakes } = await listBakes();
  $('version').textContent = generator;
  $('bakes').replaceChildren(...bakes.map((b) => element('option', b.name, { value: b.name })));
  $('bakes-row').hidden = bakes.length < 2;
  if (bake) $('bakes').value = bake.name;
  stamp = bakes.find((b) => b.name === bake?.name)?.stamp;
  return bakes;
}

async function start() {
  readAddress();
  try {
    stage = new Stage($('stage'));
  } catch {
    throw new Error('This page needs WebGL 2, which this browser does not provide.');
  }
  controls = new Controls(stage, noteAddress);
  controls.mode = 'orbit';
  mixer = new Mixer(stage.renderer);
  const bakes = await listStamp();
  if (bakes.length === 0) throw new Error('The folder no longer contains a bake.');
  const name = bakes.some((b) => b.name === state.bake) ? state.bake : bakes[0].name;
  stamp = bakes.find((b) => b.name === name).stamp;
  await open(name, false);
  $('bakes').value = name;
  listen();
  let last = performance.now();
  const frame = (now) => {
    controls.step((now - last) / 1000);
    last = now;
    if (stage.draw()) document.body.dataset.drawn = String(Number(document.body.dataset.drawn ?? 0) + 1);
    requestAnimationFrame(frame);
  };
  requestAnimationFrame(frame);
  setTimeout(watch, WATCH);
}

/** For the console and tests. */
globalThis.lumel = {
  state,
  get stage() {
    return stage;
  },
  busy: () => applied !== turn,
  opened: () => opened,
  /** Projects a point of the level to the page. */
  project(x, y, z) {
    const at = stage.camera.position.clone().set(x, y, z).project(stage.camera);
    const box = stage.canvas.getBoundingClientRect();
    return [box.left + (0.5 + 0.5 * at.x) * box.width, box.top + (0.5 - 0.5 * at.y) * box.height];
  },
};

start().catch(fail);
