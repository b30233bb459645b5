/** Gaussians as a binary PLY file of 3DGS (Kerbl et al. 2023, reference implementation, GaussianModel.save_ply). */

import type { Gaussians } from "../receiver/gaussians";

const OPACITY_MARGIN = 1e-6; // opacities 0 and 1 have no finite logit; they are stored this far inside

/** Return the bytes of a file that fecosplat decode and viewers of 3DGS read. */
export function plyBytes(gaussians: Gaussians): Uint8Array<ArrayBuffer> {
  const names = propertyNames(gaussians.numHarmonics);
  const header =
    `ply\nformat binary_little_endian 1.0\nelement vertex ${gaussians.count}\n` +
    names.map((name) => `property float ${name}\n`).join("") +
    "end_header\n";
  const start = new TextEncoder().encode(header);
  const bytes = new Uint8Array(start.length + 4 * names.length * gaussians.count);
  bytes.set(start);
  const view = new DataView(bytes.buffer, start.length);
  let at = 0;
  for (let index = 0; index < gaussians.count; index++) {
    for (const value of vertex(gaussians, index)) view.setFloat32(at++ * 4, value, true);
  }
  return bytes;
}

function propertyNames(numHarmonics: number): string[] {
  const rest = Array.from({ length: 3 * (numHarmonics - 1) }, (_, at) => `f_rest_${at}`);
  return [
    ...["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", ...rest],
    ...["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"],
  ];
}

function vertex({ means, scales, rotations, opacities, harmonics, numHarmonics }: Gaussians, index: number): number[] {
  const coefficients = harmonics.subarray(3 * numHarmonics * index, 3 * numHarmonics * (index + 1));
  const rest: number[] = [];
  for (let channel = 0; channel < 3; channel++) {
    for (let at = 1; at < numHarmonics; at++) rest.push(coefficients[3 * at + channel]);
  }
  const opacity = Math.min(Math.max(opacities[index], OPACITY_MARGIN), 1 - OPACITY_MARGIN);
  return [
    ...means.subarray(3 * index, 3 * index + 3),
    ...[0, 0, 0],
    ...coefficients.subarray(0, 3),
    ...rest,
    Math.log(opacity) - Math.log1p(-opacity),
    ...scales.subarray(3 * index, 3 * index + 3).map(Math.log),
    ...rotations.subarray(4 * index, 4 * index + 4),
  ];
}
