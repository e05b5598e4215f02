"use strict";
// From pixels to a blob: gvp_lib.perception, number for number. Thesis 2.1; errata 1 to 5.
const perception = (() => {
  const HUE_SLACK = 0.65, SATURATION_SLACK = 0.53, AXES_DIFFER = 1.5 * 4 / Math.sqrt(12);

  // OpenCV divides by tables: 255 / v and 256 / (6 chroma), in steps of 1/4096, rounded half to even.
  const even = (x) => { const whole = Math.round(x); return Math.abs(x % 1) === 0.5 ? 2 * Math.round(x / 2) : whole; };
  const OVER_VALUE = new Int32Array(256), OVER_CHROMA = new Int32Array(256);
  for (let i = 1; i < 256; i++) {
    OVER_VALUE[i] = even((255 << 12) / i);
    OVER_CHROMA[i] = even((256 << 12) / (6 * i));
  }

  /** Ranges of 8-bit HSV that a pixel may lie in, and whether red and blue are exchanged first: HsvThreshold._plan. */
  function planOf({ hue: [start, end], saturation, value }) {
    const steps = (low, high, scale, slack) =>
      [Math.ceil(low * scale - slack - 1e-9), Math.floor(high * scale + slack + 1e-9)];
    const turned = (x) => ((x % 360) + 360) % 360;
    const s = steps(...saturation, 255, SATURATION_SLACK), v = steps(...value, 255, 0);
    if (turned(end - start) === 0 && end !== start) return { swap: false, hues: [[0, 255]], s, v };
    let [first, last] = steps(start, end >= start ? end : end + 360, 256 / 360, HUE_SLACK), swap = false;
    if (last > 255 && s[0] > 0) {
      const mirrored = steps(turned(240 - end), turned(240 - end) + turned(end - start), 256 / 360, HUE_SLACK);
      if (mirrored[1] <= 255) [swap, [first, last]] = [true, mirrored];
    }
    return { swap, hues: [[first, Math.min(last, 255)], ...(last > 255 ? [[0, last - 256]] : [])], s, v };
  }

  /** Thresholds of hue, saturation and value, then opening and closing: HsvThreshold. */
  class Threshold {
    constructor(ranges, width, height) {
      Object.assign(this, { ranges, width, height, plan: planOf(ranges) });
      [this.set, this.rows] = [0, 0].map(() => new Uint8Array(width * height));
      this.sums = new Int32Array(Math.max(width, height) + 1);
    }

    /** Mask of RGBA pixels, row by row from the top. */
    mask(rgba) {
      const { width, height, set, plan: { swap, hues, s: [s0, s1], v: [v0, v1] } } = this;
      const red = swap ? 2 : 0, blue = 2 - red, [[a0, a1], [b0, b1] = [256, -1]] = hues;
      let [left, right, top, bottom] = [width, -1, height, -1];
      for (let y = 0, k = 0, at = 0; y < height; y++) for (let x = 0; x < width; x++, k++, at += 4) {
        const r = rgba[at + red], g = rgba[at + 1], b = rgba[at + blue];
        const v = Math.max(r, g, b), chroma = v - Math.min(r, g, b), s = (chroma * OVER_VALUE[v] + 2048) >> 12;
        set[k] = 0;
        if (s < s0 || s > s1 || v < v0 || v > v1) continue;
        let hue = v === r ? g - b : v === g ? b - r + 2 * chroma : r - g + 4 * chroma;
        hue = (hue * OVER_CHROMA[chroma] + 2048) >> 12;
        hue = Math.min(255, hue < 0 ? hue + 256 : hue);
        if ((hue < a0 || hue > a1) && (hue < b0 || hue > b1)) continue;
        set[k] = 1;
        if (x < left) left = x;
        if (x > right) right = x;
        if (y < top) top = y;
        bottom = y;
      }
      const reach = this.ranges.kernelSize >> 1;
      if (!reach || right < 0) return set;
      // Nothing beyond what is set, and twice the kernel's reach, can change.
      this.box = [Math.max(0, left - 2 * reach), Math.max(0, top - 2 * reach),
        Math.min(width, right + 2 * reach + 1), Math.min(height, bottom + 2 * reach + 1)];
      for (const dilate of [false, true, true, false]) this.filtered(set, dilate, reach);  // open, then close
      return set;
    }

    /** Erosion or dilation of the mask by a square, in place; what lies outside of the picture does not count. */
    filtered(mask, dilate, reach) {
      const [x0, y0, x1, y1] = this.box, { width, rows, sums } = this;
      const along = (from, to, start, step, count, beyond) => {
        for (let i = 0; i < count; i++) sums[i + 1] = sums[i] + from[start + i * step];
        for (let i = 0; i < count; i++) {
          const low = Math.max(0, i - reach), high = Math.min(count, i + reach + 1), set = sums[high] - sums[low];
          const asked = high - low + (beyond(i - reach < 0, i + reach + 1 > count) ? 1 : 0);
          to[start + i * step] = dilate ? +(set > 0) : +(set === asked);
        }
      };
      // The box's own border is not the picture's: beyond it, within the picture, nothing is set.
      const atRow = (before, after) => (before && x0 > 0) || (after && x1 < width);
      const atColumn = (before, after) => (before && y0 > 0) || (after && y1 < this.height);
      for (let y = y0; y < y1; y++) along(mask, rows, y * width + x0, 1, x1 - x0, atRow);
      for (let x = x0; x < x1; x++) along(rows, mask, y0 * width + x, width, y1 - y0, atColumn);
    }
  }

  /** The pixels of a box that have a value, by their moments, or null where none has: Blob.from_mask. */
  function blobOf(mask, width, [x0, y0, x1, y1], value = 1) {
    let [left, right, top, bottom] = [x1, -1, y1, -1];
    let [m00, m10, m01, m20, m11, m02] = [0, 0, 0, 0, 0, 0];
    for (let y = y0; y < y1; y++) {
      let [n, sum, squares] = [0, 0, 0];
      for (let x = x0; x < x1; x++) if (mask[y * width + x] === value) {
        n++; sum += x - x0; squares += (x - x0) ** 2;
        if (x < left) left = x;
        if (x > right) right = x;
      }
      if (!n) continue;
      top = Math.min(top, y);
      bottom = y;
      const v = y - y0;
      m00 += n; m10 += sum; m01 += n * v; m20 += squares; m11 += v * sum; m02 += n * v * v;
    }
    if (!m00) return null;
    const square = m00 * m00;
    return new Blob({
      area: m00, centroid: [x0 + m10 / m00, y0 + m01 / m00], bbox: [left, top, right + 1, bottom + 1],
      mu20: (m20 * m00 - m10 * m10) / square, mu11: (m11 * m00 - m10 * m01) / square,
      mu02: (m02 * m00 - m01 * m01) / square,
    });
  }

  /** Set pixels by their moments: Blob. Lengths in px, angles in rad. */
  class Blob {
    constructor(fields) { Object.assign(this, fields); }

    get largest() { return 0.5 * (this.mu20 + this.mu02 + Math.hypot(2 * this.mu11, this.mu20 - this.mu02)); }
    get major() { return 4 * Math.sqrt(this.largest); }
    get minor() {
      const determinant = Math.max(0, this.mu20 * this.mu02 - this.mu11 * this.mu11);
      return this.largest ? 4 * Math.sqrt(determinant / this.largest) : 0;
    }
    get ratio() { return this.major ? this.minor / this.major : 1; }
    get orientation() {
      if (!(this.major - this.minor > AXES_DIFFER)) return NaN;
      const angle = 0.5 * Math.atan2(2 * this.mu11, this.mu20 - this.mu02);
      return angle > -0.5 * Math.PI ? angle : 0.5 * Math.PI;
    }
    touchesBorder(width, height) {
      const [left, top, right, bottom] = this.bbox;
      return left <= 0 || top <= 0 || right >= width || bottom >= height;
    }
  }

  /** Blobs of connected regions, the largest first: blobs_from_mask. Leaves the mask as it was. */
  function blobsOf(mask, width, height, least) {
    const label = new Int32Array(mask.length), stack = [], found = [];
    for (let start = 0; start < mask.length; start++) {
      if (!mask[start] || label[start]) continue;
      const number = found.length + 1, box = [width, height, 0, 0];
      label[start] = number;
      stack.push(start);
      while (stack.length) {
        const k = stack.pop(), x = k % width, y = (k - x) / width;
        box[0] = Math.min(box[0], x); box[1] = Math.min(box[1], y);
        box[2] = Math.max(box[2], x + 1); box[3] = Math.max(box[3], y + 1);
        for (let v = Math.max(0, y - 1); v <= Math.min(height - 1, y + 1); v++) {
          for (let u = Math.max(0, x - 1); u <= Math.min(width - 1, x + 1); u++) {
            const next = v * width + u;
            if (mask[next] && !label[next]) { label[next] = number; stack.push(next); }
          }
        }
      }
      found.push(box);
    }
    const blobs = found.map((box, i) => blobOf(label, width, box, i + 1));
    return blobs.filter((blob) => blob.area >= least).sort((a, b) => b.area - a.area);
  }

  /** Which blob is the object's, from picture to picture: Tracker, which begins with the one nearest the middle. */
  class Tracker {
    constructor(maxGrowth = 1.5, maxShift = 0.3, least = 50) {
      Object.assign(this, { maxGrowth, maxShift, least, last: null });
    }

    expect(blob) { this.last = blob; }

    observe(mask, width, height, expected = null) {
      const blobs = blobsOf(mask, width, height, this.least), last = this.last;
      const goal = expected ?? last?.centroid ?? [0.5 * (width - 1), 0.5 * (height - 1)];
      let found = null, least = Infinity;
      for (const blob of blobs) {
        const shift = Math.hypot(blob.centroid[0] - goal[0], blob.centroid[1] - goal[1]) / (this.maxShift * width);
        const grown = last ? Math.abs(Math.log(blob.area / last.area)) / Math.log(this.maxGrowth) : 0;
        if (last && (shift > 1 || grown > 1)) continue;
        if (shift + grown < least) [found, least] = [blob, shift + grown];
      }
      if (found) this.last = found;
      return found;
    }
  }

  return { Threshold, Blob, blobOf, blobsOf, Tracker };
})();
