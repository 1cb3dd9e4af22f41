/* Shapes of a cell, made from its geometry: arm, tool, work piece, path, force. Used by `cell.js`. */
"use strict";
var HilParts = (() => {
  const {Mesh, plus, minus, dot, cross, size, unit, times, turned, IDENTITY} = HilSpace;
  const BODY = [0.80, 0.83, 0.87], JOINT = [0.30, 0.35, 0.41], SENSOR = [0.0, 0.45, 0.70], TOOL = [0.46, 0.50, 0.55];
  const PIECE = [0.80, 0.74, 0.62], STAND = [0.62, 0.66, 0.71];
  const WIDTHS = [0.078, 0.066, 0.056, 0.044, 0.036, 0.032, 0.030];   // radius of each link, by the reach of the arm
  const SENSOR_M = 0.035, THICK_M = 0.02, LIFT_M = 0.0004, LEAST_M = 0.0004;

  function links(arm) {   // a mesh for each link, with all joint angles at 0
    const points = [...arm.axes.map(axis => axis.point), flange(arm)], lengths = points.slice(1).map((p, k) => size(minus(p, points[k])));
    const reach = lengths.slice(1).reduce((sum, one) => sum + one, 0), r = k => WIDTHS[k] * reach;
    const made = points.map(() => new Mesh());
    made[0].tube([0, 0, 0], [0, 0, 0.025 * reach], 1.75 * r(0), 1.6 * r(0), JOINT);
    points.forEach((begin, k) => {
      if (k === 6) return;
      const end = points[k + 1], {direction} = arm.axes[k], mesh = made[k + 1], foot = plus(begin, direction, dot(minus(end, begin), direction));
      const bent = size(minus(foot, begin)) > 0.02 && size(minus(end, foot)) > 0.02, corner = bent ? foot : null;
      const from = k ? begin : plus(begin, [0, 0, 1], 0.025 * reach), width = [r(k), r(k + 1)];
      if (corner) mesh.tube(from, corner, width[0], width[0] * 0.95, BODY).ball(corner, width[0] * 0.95, BODY).tube(corner, end, width[0] * 0.9, width[1], BODY);
      else if (size(minus(end, from)) > 0.02) mesh.tube(from, end, width[0], width[1], BODY);
      if (k < 5 && Math.abs(dot(arm.axes[k + 1].direction, direction)) < 0.9 || k === 1 || k === 2) hub(mesh, arm.axes[k + 1], r(k + 1));
    });
    return made;
  }

  function hub(mesh, axis, r) {   // housing of the joint at the end of a link
    const half = 1.25 * r, [a, b] = [-half, half].map(by => plus(axis.point, axis.direction, by));
    mesh.tube(a, b, 1.18 * r, 1.18 * r, JOINT);
  }

  function flange(arm) { return plus(arm.tip, arm.direction, -arm.tool); }

  function placed(arm, degrees) {   // matrices of the links at these joint angles; the first is that of the base
    const made = [IDENTITY];
    arm.axes.forEach(({point, direction, less}, k) => {
      const angle = (degrees[k] - (less ? degrees[less - 1] : 0)) * Math.PI / 180;
      made.push(times(made[k], turned(point, direction, angle)));
    });
    return made;
  }

  function tool(length, radius, colours = [SENSOR, TOOL]) {   // in its own frame: the tip at 0, z out of the tool
    const mesh = new Mesh(), at = z => [0, 0, -z], top = Math.max(length, 0.06), neck = Math.max(0.008, Math.min(radius, 0.02));
    mesh.tube(at(top), at(top - SENSOR_M), 0.042, 0.042, colours[0]).tube(at(top - SENSOR_M), at(top - SENSOR_M - 0.008), 0.03, 0.03, colours[1]);
    const body = Math.min(0.05, top / 3);
    mesh.tube(at(top - SENSOR_M), at(body), 0.016, 0.014, colours[1]);
    if (radius > 0.002) mesh.tube(at(body), at(0.012), 0.014, Math.max(neck, 0.01), colours[1]).tube(at(0.012), at(0), radius, radius, colours[1]);
    else mesh.tube(at(body), at(0), 0.014, 0.0012, colours[1]);
    return mesh;
  }

  function grid(piece) {   // position of a node, and height at a place
    const {corner, along, spacing, heights} = piece, [u, v] = [[...along, 0], [-along[1], along[0], 0]];
    const node = (i, k) => plus(plus([...corner, heights[i][k]], u, i * spacing[0]), v, k * spacing[1]);
    const height = ([x, y]) => {
      const from = [x - corner[0], y - corner[1], 0], i = dot(from, u) / spacing[0], k = dot(from, v) / spacing[1];
      const a = Math.min(Math.max(Math.floor(i), 0), heights.length - 2), b = Math.min(Math.max(Math.floor(k), 0), heights[0].length - 2);
      const [s, t] = [i - a, k - b], four = [heights[a][b], heights[a + 1][b], heights[a][b + 1], heights[a + 1][b + 1]];
      if (s < -0.5 || t < -0.5 || s > 1.5 || t > 1.5 || four.some(one => one === null)) return null;
      return four[0] * (1 - s) * (1 - t) + four[1] * s * (1 - t) + four[2] * (1 - s) * t + four[3] * s * t;
    };
    return {node, height, rows: heights.length, columns: heights[0].length, known: (i, k) => heights[i][k] !== null};
  }

  function piece(given) {   // solid below the surface, on a stand
    const mesh = new Mesh(), table = new Mesh(), {node, rows, columns, known} = grid(given), lowest = Math.min(...given.heights.flat().filter(one => one !== null));
    const floor = lowest - THICK_M, down = p => [p[0], p[1], floor];
    const normal = (i, k) => {
      const near = (a, b) => (a >= 0 && b >= 0 && a < rows && b < columns && known(a, b) ? node(a, b) : node(i, k));
      const n = cross(minus(near(i + 1, k), near(i - 1, k)), minus(near(i, k + 1), near(i, k - 1)));
      return size(n) > 1e-12 ? unit(n) : [0, 0, 1];
    };
    const full = (i, k) => i >= 0 && k >= 0 && i < rows - 1 && k < columns - 1 && [[0, 0], [1, 0], [1, 1], [0, 1]].every(([a, b]) => known(i + a, k + b));
    for (let i = 0; i < rows - 1; i++) for (let k = 0; k < columns - 1; k++) {
      if (!full(i, k)) continue;
      const corners = [[i, k], [i + 1, k], [i + 1, k + 1], [i, k + 1]];
      for (const m of [0, 1, 2, 0, 2, 3]) mesh.vertex(node(...corners[m]), normal(...corners[m]), PIECE);
      [[i, k - 1, 0, 1], [i + 1, k, 1, 2], [i, k + 1, 2, 3], [i - 1, k, 3, 0]].forEach(([a, b, from, to]) => {
        if (full(a, b)) return;
        const [p, q] = [node(...corners[from]), node(...corners[to])];
        mesh.quad(p, q, down(q), down(p), unit(cross(minus(q, p), [0, 0, 1])), PIECE);
      });
    }
    if (floor > 0.06) stand(table, node(Math.floor(rows / 2), Math.floor(columns / 2)), floor, Math.max(rows * given.spacing[0], columns * given.spacing[1]));
    return {mesh, table};
  }

  function stand(mesh, [x, y], top, wide) {   // table below the piece
    const half = Math.max(0.2, 0.8 * wide), low = top - 0.025, post = Math.max(0.05, 0.2 * half);
    const ring = z => [[x - half, y - half, z], [x + half, y - half, z], [x + half, y + half, z], [x - half, y + half, z]];
    const [upper, lower] = [ring(top), ring(low)];
    mesh.quad(...upper, [0, 0, 1], STAND).quad(...lower, [0, 0, -1], STAND);
    upper.forEach((p, k) => { const m = (k + 1) % 4; mesh.quad(p, upper[m], lower[m], lower[k], unit(cross(minus(upper[m], p), [0, 0, 1])), STAND); });
    mesh.tube([x, y, 0.015], [x, y, low], post, post, STAND, 32).tube([x, y, 0], [x, y, 0.015], 2.2 * post, 2 * post, STAND, 32);
  }

  function removed(map, height, colour) {   // depths on the surface; nothing where nothing was removed
    const mesh = new Mesh(), {corner, along, spacing, depths} = map, [u, v] = [[...along, 0], [-along[1], along[0], 0]];
    const node = (i, k) => { const p = plus(plus([...corner, 0], u, i * spacing), v, k * spacing); p[2] = (height(p) ?? map.level) + LIFT_M; return p; };
    for (let i = 0; i < depths.length - 1; i++) for (let k = 0; k < depths[0].length - 1; k++) {
      const corners = [[i, k], [i + 1, k], [i + 1, k + 1], [i, k + 1]], deep = corners.map(([a, b]) => depths[a][b]);
      if (Math.max(...deep) <= 0) continue;
      for (const m of [0, 1, 2, 0, 2, 3]) mesh.vertex(node(...corners[m]), [0, 0, 1], colour(deep[m]));
    }
    return mesh;
  }

  function ribbon(places, up, width, height, cut) {   // path on the surface; `places` are [point, colour, time, whether it continues the one before]; counts by place
    const mesh = new Mesh(), counts = [0], lifted = p => {
      const z = height ? height(p) : null;
      return z === null || Math.abs(z - p[2]) > 0.02 ? plus(p, up, LIFT_M) : [p[0], p[1], z + LIFT_M];
    };
    let last = null, from = 0;
    for (let k = 1; k < places.length; k++) {
      const [p, colour] = places[from], [q, , , continues] = places[k], step = minus(q, p), across = cross(up, step);
      if (!continues || size(step) >= cut) { last = null; from = k; }
      else if (size(step) > LEAST_M && size(across) > 1e-7) {   // noise has no direction
        const s = unit(across).map(one => one * width / 2), begin = last || [plus(p, s), minus(p, s)].map(lifted), end = [plus(q, s), minus(q, s)].map(lifted);
        mesh.quad(begin[0], end[0], end[1], begin[1], up, colour);
        last = end; from = k;
      }
      counts.push(mesh.count);
    }
    return {mesh, counts};
  }

  function arrow() {   // along z, 1 m long; x and y are widths
    return new Mesh().tube([0, 0, 0], [0, 0, 0.72], 0.5, 0.5, TOOL).tube([0, 0, 0.72], [0, 0, 1], 1.25, 0, TOOL);
  }

  function floor(reach, step) {
    const mesh = new Mesh(true), most = Math.ceil(reach / step);
    for (let k = -most; k <= most; k++) {
      mesh.line([k * step, -most * step, 0], [k * step, most * step, 0], BODY).line([-most * step, k * step, 0], [most * step, k * step, 0], BODY);
    }
    return mesh;
  }

  return {links, placed, flange, tool, grid, piece, removed, ribbon, arrow, floor};
})();
