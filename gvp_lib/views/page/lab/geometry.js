"use strict";
// Poses and the lens: what gvp_lib.geometry does with NumPy and SciPy. A pose has a place p, m, and a rotation R, its
// nine numbers row by row; a camera's axes are x to the right, y down and z ahead.
const geometry = (() => {
  const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);
  const norm = (a) => Math.hypot(...a);
  const add = (a, b, scale = 1) => a.map((x, i) => x + scale * b[i]);
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const clip = (x, low, high) => Math.min(high, Math.max(low, x));
  const column = (R, k) => [R[k], R[3 + k], R[6 + k]];
  const apply = (R, v) => [0, 3, 6].map((i) => R[i] * v[0] + R[i + 1] * v[1] + R[i + 2] * v[2]);
  const transposed = (R) => [R[0], R[3], R[6], R[1], R[4], R[7], R[2], R[5], R[8]];
  const times = (A, B) => [0, 3, 6].flatMap((i) => [0, 1, 2].map((k) =>
    A[i] * B[k] + A[i + 1] * B[3 + k] + A[i + 2] * B[6 + k]));
  const identity = [1, 0, 0, 0, 1, 0, 0, 0, 1];

  /** Rotation of a rotation vector, rad: Rodrigues. */
  function rotation([x, y, z]) {
    const angle = Math.hypot(x, y, z);
    if (angle < 1e-12) return [1, -z, y, z, 1, -x, -y, x, 1];
    const [a, b, c] = [x / angle, y / angle, z / angle], s = Math.sin(angle), t = 1 - Math.cos(angle), u = 1 - t;
    return [t * a * a + u, t * a * b - s * c, t * a * c + s * b, t * a * b + s * c, t * b * b + u, t * b * c - s * a,
      t * a * c - s * b, t * b * c + s * a, t * c * c + u];
  }

  /** Rotation vector of a rotation, rad; its length is at most pi. */
  function vector(R) {
    const v = [R[7] - R[5], R[2] - R[6], R[3] - R[1]], sine = 0.5 * norm(v), cosine = 0.5 * (R[0] + R[4] + R[8] - 1);
    if (sine > 1e-7) return v.map((x) => x * (0.5 * Math.atan2(sine, cosine) / sine));
    if (cosine > 0) return v.map((x) => 0.5 * x);
    const k = [0, 1, 2].reduce((best, i) => (R[4 * i] > R[4 * best] ? i : best), 0);  // half a turn
    const axis = column(R, k).map((x, i) => x + (i === k ? 1 : 0));
    return axis.map((x) => (Math.PI * x) / norm(axis));
  }

  const pose = (p = [0, 0, 0], R = identity) => ({ p, R });
  const shift = (x, y, z) => pose([x, y, z]);
  const turn = (v) => pose([0, 0, 0], rotation(v));
  const compose = (a, b) => pose(add(a.p, apply(a.R, b.p)), times(a.R, b.R));
  function inverse({ p, R }) {
    const back = transposed(R);
    return pose(apply(back, p).map((x) => -x), back);
  }

  /** The solution of n linear equations, by Gauss's elimination with pivots. */
  function solve(matrix, right) {
    const n = right.length, rows = matrix.map((row, i) => [...row, right[i]]);
    for (let c = 0; c < n; c++) {
      let pivot = c;
      for (let r = c + 1; r < n; r++) if (Math.abs(rows[r][c]) > Math.abs(rows[pivot][c])) pivot = r;
      [rows[c], rows[pivot]] = [rows[pivot], rows[c]];
      for (let r = 0; r < n; r++) {
        const factor = r === c ? 0 : rows[r][c] / rows[c][c];
        if (factor) for (let k = c; k <= n; k++) rows[r][k] -= factor * rows[c][k];
      }
    }
    return rows.map((row, i) => row[n] / row[i]);
  }

  /** Direction of a pixel's ray, z = 1: CameraIntrinsics.rays, but for its length. */
  const ray = (lens, [u, v]) => [(u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy, 1];

  /** Viewpoint of a sphere: VirtualSphere.viewpoint, the pole straight up. */
  function viewpoint(center, radius, tilt, azimuth, roll = 0) {
    const [s, c, sa, ca] = [Math.sin(tilt), Math.cos(tilt), Math.sin(azimuth), Math.cos(azimuth)];
    const out = [s * ca, s * sa, c], right = [-sa, ca, 0], ahead = out.map((x) => -x), down = cross(ahead, right);
    const R = [0, 1, 2].flatMap((i) => [right[i], down[i], ahead[i]]);
    return pose(add(center, out, radius), times(R, rotation([0, 0, roll])));
  }

  return { dot, norm, add, cross, clip, column, apply, transposed, times, rotation, vector, pose, shift, turn, compose,
    inverse, solve, ray, viewpoint };
})();
