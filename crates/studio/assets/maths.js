// Rotations as nine numbers by rows, points as three; and cameras: x right, y down, z forward.

export const multiply = (a, b) =>
  Array.from({ length: 9 }, (_, i) => [0, 1, 2].reduce((sum, k) => sum + a[3 * Math.floor(i / 3) + k] * b[3 * k + (i % 3)], 0));
export const apply = (m, p) => [0, 1, 2].map((i) => m[3 * i] * p[0] + m[3 * i + 1] * p[1] + m[3 * i + 2] * p[2]);
export const transposed = (m) => [m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]];
export const cross = ([a, b, c], [x, y, z]) => [b * z - c * y, c * x - a * z, a * y - b * x];
export const plus = (a, b) => a.map((x, i) => x + b[i]);
export const minus = (a, b) => a.map((x, i) => x - b[i]);
export const times = (a, s) => a.map((x) => x * s);

/** The rotation by a rotation vector (Rodrigues). */
export function turn([x, y, z]) {
  const angle = Math.hypot(x, y, z);
  if (angle < 1e-12) return [1, 0, 0, 0, 1, 0, 0, 0, 1];
  const [a, b, c] = [x / angle, y / angle, z / angle];
  const [sin, cos] = [Math.sin(angle), Math.cos(angle)];
  const v = 1 - cos;
  return [
    cos + a * a * v, a * b * v - c * sin, a * c * v + b * sin,
    a * b * v + c * sin, cos + b * b * v, b * c * v - a * sin,
    a * c * v - b * sin, b * c * v + a * sin, cos + c * c * v,
  ];
}

/** The pixel of a world point for `{r, t, f, cx, cy}` without distortion, or null behind the camera. */
export function project({ r, t, f, cx, cy }, point) {
  const [x, y, z] = plus(apply(r, point), t);
  return z > 0 ? [(f * x) / z + cx, (f * y) / z + cy, z] : null;
}

export const clamp = (x, low, high) => Math.min(Math.max(x, low), high);
