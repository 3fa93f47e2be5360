/**
 * Reads the KTX2 files that `lumel bake --ktx2` writes: one level, no supercompression, BC6H, rgb9e5 or (shadow masks) RGBA8, row 0 at the top.
 *
 * The KTX2 readers of these engines support Basis and a few other formats, but none supports both BC6H and rgb9e5.
 */

/** VkFormat numbers. */
const FORMATS = { 143: 'bc6h', 123: 'rgb9e5', 37: 'rgba8' };

const MAGIC = [0xab, 0x4b, 0x54, 0x58, 0x20, 0x32, 0x30, 0xbb, 0x0d, 0x0a, 0x1a, 0x0a];

/**
 * @param {ArrayBuffer} buffer A file.
 * @returns {{width: number, height: number, format: 'bc6h' | 'rgb9e5' | 'rgba8', data: Uint8Array | Uint32Array}}
 *   Uint8Array with 16 bytes per 4×4 texels (BC6H) or bytes R, G, B, A; Uint32Array with one word per texel (rgb9e5).
 */
export function parseKtx2(buffer) {
  const view = new DataView(buffer);
  if (buffer.byteLength < 104 || MAGIC.some((byte, i) => view.getUint8(i) !== byte)) throw new Error('this is no KTX2 file');
  const u32 = (at) => view.getUint32(at, true);
  const format = FORMATS[u32(12)];
  const [width, height, depth, layers, faces, levels, scheme] = [20, 24, 28, 32, 36, 40, 44].map(u32);
  if (!format || depth > 0 || layers > 0 || faces !== 1 || levels !== 1 || scheme !== 0) {
    throw new Error('this KTX2 file holds something else than a page that `lumel bake --ktx2` writes');
  }
  const [offset, length] = [80, 88].map((at) => Number(view.getBigUint64(at, true)));
  const expected = format === 'bc6h' ? 16 * Math.ceil(width / 4) * Math.ceil(height / 4) : 4 * width * height;
  if (length !== expected || offset + length > buffer.byteLength) throw new Error('this KTX2 file is cut off');
  const data = format !== 'rgb9e5' ? new Uint8Array(buffer, offset, length) : new Uint32Array(buffer.slice(offset, offset + length));
  return { width, height, format, data };
}

/**
 * Reads a cube map that `lumel bake` wrote.
 *
 * @param {ArrayBuffer} buffer A file.
 * @returns {{size: number, faces: Uint32Array[]}} The largest level: +X, -X, +Y, -Y, +Z, -Z of KTX2, one word of rgb9e5 per texel.
 */
export function parseCubeKtx2(buffer) {
  const view = new DataView(buffer);
  if (buffer.byteLength < 104 || MAGIC.some((byte, i) => view.getUint8(i) !== byte)) throw new Error('this is no KTX2 file');
  const [format, size, height, faces, scheme] = [12, 20, 24, 36, 44].map((at) => view.getUint32(at, true));
  if (FORMATS[format] !== 'rgb9e5' || size !== height || faces !== 6 || scheme !== 0) throw new Error('this KTX2 file is no reflection of Lumel');
  const offset = Number(view.getBigUint64(80, true));
  const bytes = 4 * size * size;
  if (offset + 6 * bytes > buffer.byteLength) throw new Error('this KTX2 file is cut off');
  const face = (i) => new Uint32Array(buffer.slice(offset + i * bytes, offset + (i + 1) * bytes));
  return { size, faces: [0, 1, 2, 3, 4, 5].map(face) };
}

/** Fetches and reads a file. */
export async function fetchKtx2(url) {
  const response = await fetch(url);
  if (!response.ok) throw new Error(`${url}: ${response.status} ${response.statusText}`);
  return parseKtx2(await response.arrayBuffer());
}
