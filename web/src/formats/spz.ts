/** Gaussians as a .spz file of Niantic, version 3: axes RUB, gzip-compressed. fecocodec/splat_files/spz.py has the layout. */

const LARGEST = 2 ** 23 - 1; // coordinates have 24 bits
const MOST_FRACTIONAL_BITS = 23;
const COLOUR_SCALE = 0.15;

/** Return the bytes of the file for a .ply file of `plyBytes`. Throws Error if the format cannot hold a coordinate. */
export async function spzBytes(ply: Uint8Array): Promise<Uint8Array<ArrayBuffer>> {
  const { rows, width } = rowsOf(ply);
  const count = rows.length / width;
  const numRest = width - 17; // harmonics of degree 1, or none
  const fractionalBits = fractionalBitsFor(rows, width);
  const attributes = [9, 1, 3, 3, 4, numRest]; // bytes a Gaussian
  const bytes = new Uint8Array(16 + count * attributes.reduce((sum, size) => sum + size));
  const header = new DataView(bytes.buffer);
  [0x5053474e, 3, count].forEach((word, at) => header.setUint32(4 * at, word, true));
  bytes.set([numRest > 0 ? 1 : 0, fractionalBits], 12);
  let start = 16;
  const streams = attributes.map((size) => {
    const stream = bytes.subarray(start, start + count * size);
    start += count * size;
    return stream;
  });
  for (let index = 0; index < count; index++) {
    const row = rows.subarray(width * index, width * (index + 1));
    [positions, opacity, colour, scales, rotation, harmonics].forEach((attribute, at) => {
      streams[at].set(attribute(row, fractionalBits), attributes[at] * index);
    });
  }
  const packed = new Blob([bytes]).stream().pipeThrough(new CompressionStream("gzip"));
  return new Uint8Array(await new Response(packed).arrayBuffer());
}

/** Return the values of all Gaussians, and how many one has: x y z, normal, f_dc, f_rest, opacity, scale, rot. */
function rowsOf(ply: Uint8Array): { rows: Float32Array; width: number } {
  const header = new TextDecoder().decode(ply.subarray(0, 2000)).split("end_header\n")[0];
  const content = ply.slice(header.length + "end_header\n".length);
  return { rows: new Float32Array(content.buffer), width: header.split("property float").length - 1 };
}

/** Return the largest number of fractional bits with which all coordinates fit. */
function fractionalBitsFor(rows: Float32Array, width: number): number {
  let farthest = 0;
  for (let at = 0; at < rows.length; at += width) {
    farthest = Math.max(farthest, Math.abs(rows[at]), Math.abs(rows[at + 1]), Math.abs(rows[at + 2]));
  }
  const bits = Math.floor(Math.log2(LARGEST / farthest));
  if (bits < 0) {
    throw new Error(`a Gaussian lies ${farthest} units from the origin, but .spz holds at most ${LARGEST}; download PLY.`);
  }
  return Math.min(bits, MOST_FRACTIONAL_BITS);
}

function positions(row: Float32Array, fractionalBits: number): number[] {
  return [row[0], -row[1], -row[2]].flatMap((x) => {
    const fixed = Math.round(x * 2 ** fractionalBits);
    return [fixed & 255, (fixed >> 8) & 255, (fixed >> 16) & 255];
  });
}

function opacity(row: Float32Array): number[] {
  return [toByte(255 / (1 + Math.exp(-row[row.length - 8])))];
}

function colour(row: Float32Array): number[] {
  return [...row.subarray(6, 9)].map((x) => toByte((x * COLOUR_SCALE + 0.5) * 255));
}

function scales(row: Float32Array): number[] {
  return [...row.subarray(row.length - 7, row.length - 4)].map((log) => toByte((log + 10) * 16));
}

/** The three smallest components of x y z w, each as sign and 9 bits, below the index of the largest one. */
function rotation(row: Float32Array): number[] {
  const [w, x, y, z] = row.subarray(row.length - 4);
  const all = [w, -z, y, -x]; // x y z w after half a turn about the x axis
  const largest = all.reduce((best, value, at) => (Math.abs(value) > Math.abs(all[best]) ? at : best), 0);
  const sign = all[largest] < 0 ? -1 : 1;
  let word = largest;
  all.forEach((value, at) => {
    if (at === largest) return;
    const magnitude = Math.min(Math.floor(Math.abs(value) * Math.SQRT2 * 511 + 0.5), 511);
    word = ((word << 10) | (sign * value < 0 ? 512 : 0) | magnitude) >>> 0;
  });
  return [word & 255, (word >> 8) & 255, (word >> 16) & 255, word >>> 24];
}

/** Coefficients of y, z and x, each with all channels; the .ply file has one channel after the other. */
function harmonics(row: Float32Array): number[] {
  if (row.length === 17) return [];
  return [-1, -1, 1].flatMap((sign, at) => [0, 1, 2].map((channel) => toByte(sign * row[9 + 3 * channel + at] * 128 + 128)));
}

function toByte(value: number): number {
  return Math.min(Math.max(Math.round(value), 0), 255);
}
