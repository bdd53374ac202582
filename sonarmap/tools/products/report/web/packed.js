// Points as points.py packs them: the twin of its `unpack`. Nothing else knows the layout of the bytes.

/** The bytes of a text in base64. */
const bytesOf = (base64) => Uint8Array.fromBase64?.(base64) ?? Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));

async function gunzip(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/**
 * The points of a map, of gzipped planes and {quantum [m], tiles: [{origin: [x, y, z] [m], count}], planes: {column: bytes a
 * number}}: {count, quantum, tiles with their `start` and `turn`, places: Uint16Array of x, y, z [quanta from the tile's origin] of
 * every point, columns: {name: whole numbers}}.
 */
async function unpack(packed, base64) {
  const planes = await gunzip(bytesOf(base64));
  const count = packed.tiles.reduce((sum, tile) => sum + tile.count, 0);
  const places = new Uint16Array(3 * count);
  const tiles = [];
  let start = 0;
  for (const tile of packed.tiles) {
    tiles.push({ ...tile, start, turn: [0, 0, 0, 1] });
    for (let axis = 0; axis < 3; axis++) {
      const low = 2 * axis * count, high = low + count;
      let at = 0;
      for (let k = start; k < start + tile.count; k++) {
        const step = planes[low + k] | (planes[high + k] << 8);
        at += (step >> 1) ^ -(step & 1); // forth even and back odd
        places[3 * k + axis] = at; // modulo 65536, as it was packed
      }
    }
    start += tile.count;
  }
  const columns = {};
  let plane = 6;
  for (const [name, size] of Object.entries(packed.planes)) {
    const begin = plane * count;
    if (size === 1) columns[name] = planes.subarray(begin, begin + count);
    else {
      const numbers = (columns[name] = new Uint32Array(count));
      for (let b = size - 1; b >= 0; b--)
        for (let k = 0; k < count; k++) numbers[k] = numbers[k] * 256 + planes[begin + b * count + k];
    }
    plane += size;
  }
  return { count, quantum: packed.quantum, tiles, places, columns };
}

/** Point k as [x, y, z] in the map's frame [m]. */
function placeOf(points, k) {
  const { origin } = points.tiles.find(({ start, count }) => k < start + count);
  return origin.map((corner, axis) => corner + points.quantum * points.places[3 * k + axis]);
}
