#!/usr/bin/env node
// Runs the Khronos glTF validator over scenes and prints a table.
//
// Usage: node validate.mjs [--json] FILE|DIR...     (DIR: every .gltf and .glb below it)
//        node validate.mjs --pairs DIR
//        (DIR: folders with in.glb and out/, from LUMEL_FUZZ_BAKED)
// Needs: the npm package gltf-validator, in node_modules of the folder LUMEL_NPM (default /opt/lumel-npm).
// Exit:  0 if no file has an error (with --pairs, none of a kind that its input has not), 1 if one
//        has, 2 on wrong usage or a missing package.
import { createRequire } from 'node:module';
import { existsSync, readFileSync, readdirSync, statSync } from 'node:fs';
import { basename, dirname, join, resolve } from 'node:path';

const npm = process.env.LUMEL_NPM ?? '/opt/lumel-npm';
let validator;
try {
  validator = createRequire(join(resolve(npm), 'package.json'))('gltf-validator');
} catch (e) {
  console.error(`gltf-validator not found under ${npm}: run tools/setup.sh or set LUMEL_NPM (${e.code ?? e})`);
  process.exit(2);
}

const args = process.argv.slice(2);
const json = args.includes('--json');
const pairs = args.includes('--pairs');
const roots = args.filter((a) => a !== '--json' && a !== '--pairs');
if (roots.length === 0) {
  console.error('usage: validate.mjs [--json | --pairs] FILE|DIR...');
  process.exit(2);
}

const files = [];
const walk = (path) => {
  if (statSync(path).isDirectory()) for (const name of readdirSync(path).sort()) walk(join(path, name));
  else if (/\.(gltf|glb)$/i.test(path)) files.push(path);
};
for (const root of roots) {
  if (!existsSync(root)) {
    console.error(`no such file: ${root}`);
    process.exit(2);
  }
  walk(root);
}

let bad = 0;
const rows = [];
for (const file of files) {
  const external = (uri) =>
    new Promise((ok, fail) => {
      const path = resolve(dirname(file), decodeURIComponent(uri));
      existsSync(path) ? ok(new Uint8Array(readFileSync(path))) : fail(`missing ${uri}`);
    });
  let issues, info;
  try {
    const report = await validator.validateBytes(new Uint8Array(readFileSync(file)), {
      uri: file, maxIssues: 0, externalResourceFunction: external,
    });
    issues = report.issues;
    info = report.info ?? {};
  } catch (e) {
    issues = { numErrors: 1, numWarnings: 0, numInfos: 0, messages: [{ severity: 0, code: 'UNREADABLE', message: String(e), pointer: '' }] };
    info = {};
  }
  if (issues.numErrors > 0) bad += 1;
  rows.push({ file, errors: issues.numErrors, warnings: issues.numWarnings, infos: issues.numInfos, triangles: info.totalTriangleCount ?? 0, messages: issues.messages });
}

if (pairs) {
  const kinds = (row) => new Map(row.messages.filter((m) => m.severity === 0).map((m) => [m.code, m]));
  const inputs = new Map(rows.filter((r) => basename(r.file) === 'in.glb').map((r) => [dirname(r.file), r]));
  const outputs = rows.filter((r) => basename(r.file) !== 'in.glb');
  bad = 0;
  for (const row of outputs) {
    const known = kinds(inputs.get(dirname(dirname(row.file))));
    const added = [...kinds(row).values()].filter((m) => !known.has(m.code));
    if (added.length > 0) bad += 1;
    for (const m of added) console.log(`${row.file}: ${m.code}: ${m.message} (${m.pointer ?? ''})`);
  }
  const wrong = [...inputs.values()].filter((r) => r.errors > 0).length;
  console.log(`${inputs.size} inputs, ${wrong} with errors; ${outputs.length} outputs, ${bad} with errors of a kind that the input has not`);
} else if (json) {
  console.log(JSON.stringify(rows));
} else {
  console.log('errors  warnings  infos  triangles  file');
  for (const r of rows) {
    console.log(`${String(r.errors).padStart(6)}  ${String(r.warnings).padStart(8)}  ${String(r.infos).padStart(5)}  ${String(r.triangles).padStart(9)}  ${r.file}`);
    const seen = new Map();
    for (const m of r.messages.filter((m) => m.severity <= 1)) {
      const key = `${m.severity} ${m.code}`;
      if (!seen.has(key)) seen.set(key, { n: 0, m });
      seen.get(key).n += 1;
    }
    for (const { n, m } of seen.values()) console.log(`        ${m.severity === 0 ? 'ERROR' : 'warning'} ×${n} ${m.code}: ${m.message} (${m.pointer ?? ''})`);
  }
  console.log(`${files.length} files, ${bad} with errors`);
}
process.exit(bad > 0 ? 1 : 0);
