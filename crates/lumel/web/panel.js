// The side panel: switches, figures of the report, and what this bake does not contain.
import { ERROR_RANGE, HEAT, VIEW } from './shading.js';
import { LAYERS } from './bake.js';

export const $ = (id) => document.getElementById(id);

/** An element with text, never HTML, because names in reports are untrusted. */
export function element(tag, text, attributes = {}) {
  const e = document.createElement(tag);
  if (text !== undefined) e.textContent = text;
  for (const [k, v] of Object.entries(attributes)) e.setAttribute(k, v);
  return e;
}

/** All views: name in the URL, title, uniform, required layer. */
export const VIEWS = [
  { name: 'lit', title: 'Level', view: VIEW.lit },
  { name: 'light', title: 'Light only', view: VIEW.white },
  { name: 'albedo', title: 'Albedo', view: VIEW.albedo },
  ...LAYERS.filter((l) => l.kind !== 'light').map((l) => ({
    name: l.name,
    title: l.title,
    view: VIEW[l.kind],
    layer: l.name,
    option: l.option,
  })),
];

/** Views of a bake; `missing` names the option that would add the required layer. */
export function viewsOf(bake) {
  return VIEWS.map((v) => ({ ...v, missing: v.layer && !bake.layers.has(v.layer) ? v.option : undefined }));
}

/** Lights of a bake, with `missing` as above. */
export function lightsOf(bake) {
  const light = LAYERS.filter((l) => l.kind === 'light');
  return [
    { name: 'all', title: 'All' },
    ...light.map((l) => ({ name: l.name, title: l.title, missing: bake.layers.has(l.name) ? undefined : l.option })),
    { name: 'groups', title: 'Groups', missing: bake.groups.length > 0 ? undefined : '--group NAME=LIGHT,…' },
  ];
}

/** Fills a group of radio buttons. */
export function choices(parent, items, current, choose) {
  parent.replaceChildren(
    ...items.map((item, i) => {
      const b = element('button', item.title, { role: 'radio', 'aria-checked': String(item.name === current), 'data-name': item.name });
      if (item.missing) {
        b.disabled = true;
        b.title = `not in this bake: lumel bake … ${item.missing}`;
      } else {
        b.title = parent.id === 'views' && i < 9 ? `${item.title} (${i + 1})` : item.title;
        b.addEventListener('click', () => choose(item.name));
      }
      return b;
    }),
  );
}

/** A slider for each light group. */
export function groupSliders(parent, groups, factors, changed) {
  parent.replaceChildren(
    ...groups.map((name) => {
      const row = element('label', undefined, { class: 'group' });
      const slider = element('input', undefined, { type: 'range', min: '0', max: '2', step: '0.05', 'aria-label': `light group ${name}` });
      slider.value = factors[name] ?? 1;
      const out = element('output', Number(slider.value).toFixed(2));
      slider.addEventListener('input', () => {
        out.textContent = Number(slider.value).toFixed(2);
        changed(name, Number(slider.value));
      });
      row.append(element('span', name, { title: name }), slider, out);
      return row;
    }),
  );
}

/** The colour scale of the view, if it has one. */
export function legend(view) {
  const box = $('legend');
  box.hidden = ![VIEW.error, VIEW.share, VIEW.direction].includes(view.view);
  if (box.hidden) return;
  const title = element('div', { [VIEW.error]: 'estimated relative error', [VIEW.direction]: 'dominant light direction as 0.5 + 0.5 (x, y, z)' }[view.view] ?? view.title);
  const parts = [title];
  if (view.view !== VIEW.direction) {
    const bar = element('canvas', undefined, { width: '200', height: '1' });
    const pen = bar.getContext('2d');
    const gradient = pen.createLinearGradient(0, 0, 200, 0);
    const stops = view.view === VIEW.error ? HEAT : [[0, 0, 0], [255, 255, 255]];
    stops.forEach((c, i) => gradient.addColorStop(i / (stops.length - 1), `rgb(${c.join(' ')})`));
    pen.fillStyle = gradient;
    pen.fillRect(0, 0, 200, 1);
    const ends = element('div');
    const [low, high] = ERROR_RANGE;
    const labels = view.view === VIEW.error ? [low, Math.sqrt(low * high), high].map((x) => `${Number((100 * x).toPrecision(2))} %`) : ['0', '0.5', '1'];
    ends.append(...labels.map((l) => element('span', l)));
    parts.push(bar, ends);
  }
  box.replaceChildren(...parts);
}

const percent = (x) => (Number.isFinite(x) ? `${(100 * x).toPrecision(3)} %` : undefined);
const count = (x) => (Number.isFinite(x) ? x.toLocaleString('en') : undefined);

const millions = (x) => `${(x / 1e6).toPrecision(3)} million`;

/** The report's figures. Fields that a report of another version lacks are left out. */
export function showReport(bake) {
  const r = bake.report;
  const box = $('report');
  box.replaceChildren(element('h2', 'Report'));
  if (!r) {
    box.append(element('p', `${bake.name}.report.json not found`, { class: 'dim' }));
    return;
  }
  const { layout, solve, gather, measured, settings } = r;
  const audit = solve?.audit;
  const rows = [
    ['scene', r.scene],
    ['quality', settings?.quality],
    ['error, median', percent(gather?.median_error)],
    ['error, root mean square', percent(gather?.estimated_error)],
    ['lumels', count(gather?.lumels)],
    ['lumels per metre', layout?.texels_per_unit],
    ['pages', layout?.pages?.map((p) => p.join(' × ')).join(', ')],
    ['charts', count(layout?.charts)],
    ['page coverage', percent(layout?.coverage)],
    ['patches', count(solve?.subdivision?.patches)],
    ['residual', solve?.relaxation?.residual?.toExponential(1)],
    ['energy imbalance', audit && `${percent(audit.imbalance)} (bound ${percent(audit.bound)})`],
    ['seams, 99 % below', percent(gather?.seams?.after?.p99)],
    ['rays', millions((gather?.lumel_rays ?? 0) + (solve?.link_rays ?? 0) + (solve?.shadow_rays ?? 0))],
    ['time', measured?.seconds !== undefined ? `${measured.seconds.toFixed(1)} s, ${measured.threads} threads` : undefined],
    ['memory', measured?.peak_bytes ? `${Math.round(measured.peak_bytes / 2 ** 20)} MiB` : undefined],
  ].filter(([, v]) => v !== undefined && v !== '' && v !== null);
  const table = element('table');
  for (const [k, v] of rows) {
    const tr = element('tr');
    tr.append(element('td', k), element('td', String(v)));
    table.append(tr);
  }
  box.append(table);
  if (r.warnings?.length > 0) {
    const list = element('ul', undefined, { class: 'warning' });
    list.append(...r.warnings.slice(0, 20).map((w) => element('li', w)));
    box.append(element('h2', `Warnings (${r.warnings.length})`), list);
  }
}

/** Layers that another bake could add. */
export function showMissing(bake) {
  const missing = [...lightsOf(bake), ...viewsOf(bake)].filter((x) => x.missing);
  const box = $('missing');
  box.replaceChildren();
  if (missing.length === 0) return;
  const layers = missing.map((m) => m.missing).filter((o) => o.startsWith('--layers ')).map((o) => o.slice(9));
  const others = missing.map((m) => m.missing).filter((o) => !o.startsWith('--layers '));
  const list = element('ul', undefined, { class: 'dim' });
  if (layers.length > 0) {
    const item = element('li');
    item.append(element('code', `--layers ${layers.join(',')}`));
    list.append(item);
  }
  for (const option of new Set(others)) {
    const item = element('li');
    item.append(element('code', option));
    list.append(item);
  }
  box.append(element('h2', 'Not in this bake'), element('div', 'lumel bake writes these layers with', { class: 'dim' }), list);
}

export function message(text, error = false) {
  const box = $('message');
  box.textContent = text;
  box.classList.toggle('error', error);
}
