/** Unit quaternions, order wxyz. */

/**
 * Return the unit quaternion, w >= 0, of a rotation matrix, row-major.
 *
 * Normalises the row of the symmetric 4x4 matrix 4 q q^T with the largest diagonal element (Shepperd, "Quaternion from
 * rotation matrix", 1978).
 */
export function quaternionOfMatrix([m00, m01, m02, m10, m11, m12, m20, m21, m22]: number[]): number[] {
  const [wx, wy, wz] = [m21 - m12, m02 - m20, m10 - m01];
  const [xy, xz, yz] = [m10 + m01, m20 + m02, m21 + m12];
  const outer = [
    [1 + m00 + m11 + m22, wx, wy, wz],
    [wx, 1 + m00 - m11 - m22, xy, xz],
    [wy, xy, 1 - m00 + m11 - m22, yz],
    [wz, xz, yz, 1 - m00 - m11 + m22],
  ];
  const diagonal = outer.map((row, at) => row[at]);
  const row = outer[diagonal.indexOf(Math.max(...diagonal))];
  const length = Math.hypot(...row) * (row[0] < 0 ? -1 : 1);
  return row.map((value) => value / length);
}

/** Return the rotation matrix, row-major, of a unit quaternion. */
export function matrixOfQuaternion(w: number, x: number, y: number, z: number): number[] {
  return [
    1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
    2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
    2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
  ];
}
