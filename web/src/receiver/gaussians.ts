/** 3D Gaussians as arrays. */

export const SH_DEGREE_0 = 0.28209479177387814;

/**
 * Gaussians in the frame and unit of length of their cameras.
 *
 * means: centres [n, 3]. scales: standard deviations [n, 3]. rotations: unit quaternions wxyz [n, 4]. opacities: in
 * [0, 1]. harmonics: coefficients [n, numHarmonics, 3] in the order of 3DGS; numHarmonics is 1 or 4.
 */
export interface Gaussians {
  count: number;
  numHarmonics: number;
  means: Float32Array;
  scales: Float32Array;
  rotations: Float32Array;
  opacities: Float32Array;
  harmonics: Float32Array;
}

export function emptyGaussians(count: number, numHarmonics: number): Gaussians {
  return {
    count,
    numHarmonics,
    means: new Float32Array(3 * count),
    scales: new Float32Array(3 * count),
    rotations: new Float32Array(4 * count),
    opacities: new Float32Array(count),
    harmonics: new Float32Array(3 * numHarmonics * count),
  };
}

/** Return the centre of a Gaussian. */
export function meanOf({ means }: Gaussians, index: number): [number, number, number] {
  return [means[3 * index], means[3 * index + 1], means[3 * index + 2]];
}

/** Return the Gaussians with a mask of 1, in the same order. */
export function keep(gaussians: Gaussians, mask: Uint8Array): Gaussians {
  const kept = new Uint32Array(mask.reduce((count, isKept) => count + isKept, 0));
  for (let index = 0, at = 0; index < mask.length; index++) if (mask[index]) kept[at++] = index;
  const { numHarmonics } = gaussians;
  return {
    count: kept.length,
    numHarmonics,
    means: rows(gaussians.means, 3, kept),
    scales: rows(gaussians.scales, 3, kept),
    rotations: rows(gaussians.rotations, 4, kept),
    opacities: rows(gaussians.opacities, 1, kept),
    harmonics: rows(gaussians.harmonics, 3 * numHarmonics, kept),
  };
}

/** Concatenate Gaussians and a layer of degree 0, whose higher harmonics are set to zero. */
export function append(gaussians: Gaussians, layer: Gaussians): Gaussians {
  const result = emptyGaussians(gaussians.count + layer.count, gaussians.numHarmonics);
  for (const field of ["means", "scales", "rotations", "opacities", "harmonics"] as const) {
    result[field].set(gaussians[field]);
  }
  result.means.set(layer.means, 3 * gaussians.count);
  result.scales.set(layer.scales, 3 * gaussians.count);
  result.rotations.set(layer.rotations, 4 * gaussians.count);
  result.opacities.set(layer.opacities, gaussians.count);
  const width = 3 * gaussians.numHarmonics;
  for (let index = 0; index < layer.count; index++) {
    const from = 3 * layer.numHarmonics * index;
    result.harmonics.set(layer.harmonics.subarray(from, from + 3), width * (gaussians.count + index));
  }
  return result;
}

function rows(values: Float32Array, width: number, indices: Uint32Array): Float32Array {
  const result = new Float32Array(width * indices.length);
  for (let at = 0; at < indices.length; at++) {
    for (let i = 0; i < width; i++) result[width * at + i] = values[width * indices[at] + i];
  }
  return result;
}
