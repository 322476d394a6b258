// A scene as topokit/pages/fragment.py packs it.
const TYPES = { u1: Uint8Array, i1: Int8Array, u2: Uint16Array, u4: Uint32Array };

export async function unpack(base64) {
  const bytes = Uint8Array.from(atob(base64.trim()), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  const buffer = await new Response(stream).arrayBuffer();
  let start = 4 + new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, start - 4)));
  const arrays = {};
  for (const [name, type, count] of header.arrays) {
    const values = new TYPES[type](buffer, start, count);
    arrays[name] = values;
    start += 4 * Math.ceil(values.byteLength / 4);
  }
  return { ...header, arrays };
}
