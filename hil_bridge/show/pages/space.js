/* Triangles and lines in space: by WebGL, and without it as flat triangles on a plain canvas. Lengths are in m.

   const view = HilSpace.open(canvas, plain)   plain: never use WebGL
   const mesh = new HilSpace.Mesh().tube(a, b, ra, rb, colour)…    a mesh that is drawn; colours are [r, g, b] of 0 … 1
   view.draw([{mesh, at, tint, alpha, lit, over, count}], camera, box)
     at     matrix of the mesh, column by column (default: none)
     tint   colour instead of the mesh's own
     over   drawn over everything before it
     lift   drawn on the surface below it
     layer  without WebGL: order of large meshes, which do not overlap later ones
     count  number of vertices (default: all)
     box    {left, top, width, height} in px of the canvas; the first box clears the canvas */
"use strict";
var HilSpace = (() => {
  const FLOATS = 9, SIDES = 32, SUN = [0.35, -0.45, 0.82];
  const plus = (a, b, k = 1) => [a[0] + b[0] * k, a[1] + b[1] * k, a[2] + b[2] * k];
  const minus = (a, b) => plus(a, b, -1);
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const size = a => Math.hypot(a[0], a[1], a[2]);
  const unit = a => { const l = size(a); return l > 1e-12 ? [a[0] / l, a[1] / l, a[2] / l] : [0, 0, 1]; };
  const aside = n => unit(cross(n, Math.abs(n[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0]));

  const IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
  function times(a, b) {
    const made = new Array(16);
    for (let c = 0; c < 4; c++) for (let r = 0; r < 4; r++) {
      made[4 * c + r] = a[r] * b[4 * c] + a[4 + r] * b[4 * c + 1] + a[8 + r] * b[4 * c + 2] + a[12 + r] * b[4 * c + 3];
    }
    return made;
  }
  const point = (m, [x, y, z]) => [0, 1, 2].map(k => m[k] * x + m[4 + k] * y + m[8 + k] * z + m[12 + k]);
  const vector = (m, [x, y, z]) => [0, 1, 2].map(k => m[k] * x + m[4 + k] * y + m[8 + k] * z);
  const frame = (x, y, z, o) => [...x, 0, ...y, 0, ...z, 0, ...o, 1];
  function posed(o, [w, x, y, z]) {   // matrix of a pose
    return frame([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
      [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
      [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], o);
  }
  function turned(c, axis, angle) {   // rotation about a line
    const s = Math.sin(angle / 2), turn = posed([0, 0, 0], [Math.cos(angle / 2), ...axis.map(one => one * s)]);
    const moved = vector(turn, c);
    turn[12] = c[0] - moved[0]; turn[13] = c[1] - moved[1]; turn[14] = c[2] - moved[2];
    return turn;
  }
  function along(o, direction, scale) {   // z along a direction, x and y of a given length
    const z = unit(direction), x = aside(z), y = cross(z, x);
    return frame(x.map(v => v * scale), y.map(v => v * scale), direction, o);
  }
  function camera({target, yaw, pitch, distance, angle = 0.6}, aspect) {
    const away = [Math.cos(pitch) * Math.cos(yaw), Math.cos(pitch) * Math.sin(yaw), Math.sin(pitch)];
    const eye = plus(target, away, distance), right = unit(cross([0, 0, 1], away)), up = cross(away, right);
    const near = distance * 0.08, far = distance * 12 + 6, f = 1 / Math.tan(angle / 2);
    const look = [right[0], up[0], away[0], 0, right[1], up[1], away[1], 0, right[2], up[2], away[2], 0,
      -dot(right, eye), -dot(up, eye), -dot(away, eye), 1];
    const lens = [f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0];
    return {matrix: times(lens, look), eye, right, up, distance, angle};
  }
  function projected({matrix}, p, box) {   // px in the box, and whether the point is in front
    const [x, y, , w] = [0, 1, 2, 3].map(k => matrix[k] * p[0] + matrix[4 + k] * p[1] + matrix[8 + k] * p[2] + matrix[12 + k]);
    return {x: box.left + (x / w + 1) / 2 * box.width, y: box.top + (1 - y / w) / 2 * box.height, front: w > 0, depth: w};
  }

  class Mesh {
    constructor(lines = false) { this.lines = lines; this.values = []; this.buffer = null; }

    get count() { return this.values.length / FLOATS; }

    vertex(p, n, c) { this.values.push(p[0], p[1], p[2], n[0], n[1], n[2], c[0], c[1], c[2]); return this; }

    line(a, b, c) { return this.vertex(a, [0, 0, 1], c).vertex(b, [0, 0, 1], c); }

    quad(a, b, c, d, n, colour) {
      for (const p of [a, b, c, a, c, d]) this.vertex(p, n, colour);
      return this;
    }

    tube(a, b, ra, rb, colour, sides = SIDES) {   // closed frustum from a to b
      const w = unit(minus(b, a)), u = aside(w), v = cross(w, u), slope = (ra - rb) / Math.max(size(minus(b, a)), 1e-9);
      const out = k => { const t = 2 * Math.PI * k / sides; return plus(u.map(one => one * Math.cos(t)), v, Math.sin(t)); };
      for (let k = 0; k < sides; k++) {
        const i = out(k), j = out(k + 1), ni = unit(plus(i, w, slope)), nj = unit(plus(j, w, slope));
        const [ai, aj, bi, bj] = [plus(a, i, ra), plus(a, j, ra), plus(b, i, rb), plus(b, j, rb)];
        for (const [p, n] of [[ai, ni], [aj, nj], [bj, nj], [ai, ni], [bj, nj], [bi, ni]]) this.vertex(p, n, colour);
        for (const p of [b, bi, bj]) this.vertex(p, w, colour);
        for (const p of [a, aj, ai]) this.vertex(p, w.map(one => -one), colour);
      }
      return this;
    }

    ball(o, r, colour, rings = 10) {
      const at = (i, k) => {
        const t = Math.PI * i / rings, f = Math.PI * k / rings;
        return [Math.sin(t) * Math.cos(f), Math.sin(t) * Math.sin(f), Math.cos(t)];
      };
      for (let i = 0; i < rings; i++) for (let k = 0; k < 2 * rings; k++) {
        const [a, b, c, d] = [at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)];
        for (const n of [a, b, c, a, c, d]) this.vertex(plus(o, n, r), n, colour);
      }
      return this;
    }
  }

  const SHADERS = [`
    attribute vec3 p, n, c; uniform mat4 view, at; uniform mediump vec4 tint; uniform float own, lit; uniform vec3 eye, sun; varying vec3 colour;
    void main() {   // light by vertex: a processor without a graphics card draws it fast
      vec4 w = at * vec4(p, 1.0); vec3 m = normalize(mat3(at) * n), v = normalize(eye - w.xyz); if (dot(m, v) < 0.0) m = -m;
      float day = 0.60 + 0.14 * m.z + 0.32 * max(dot(m, sun), 0.0);
      colour = mix(tint.rgb, c, own) * mix(1.0, day, lit); gl_Position = view * w;
    }`, `
    precision mediump float; uniform vec4 tint; varying vec3 colour;
    void main() { gl_FragColor = vec4(colour, tint.a); }`];

  class Webgl {
    constructor(canvas, gl) {
      this.kind = "webgl"; this.canvas = canvas; this.gl = gl; this.era = 0;
      canvas.addEventListener("webglcontextlost", event => event.preventDefault());
      canvas.addEventListener("webglcontextrestored", () => this.begin());
      this.begin();
    }

    begin() {
      const {gl} = this, program = gl.createProgram();
      SHADERS.forEach((text, k) => {
        const shader = gl.createShader(k ? gl.FRAGMENT_SHADER : gl.VERTEX_SHADER);
        gl.shaderSource(shader, text); gl.compileShader(shader); gl.attachShader(program, shader);
      });
      ["p", "n", "c"].forEach((name, k) => gl.bindAttribLocation(program, k, name));
      gl.linkProgram(program); gl.useProgram(program);
      this.at = Object.fromEntries(["view", "at", "tint", "own", "lit", "eye", "sun"].map(name => [name, gl.getUniformLocation(program, name)]));
      gl.uniform3fv(this.at.sun, unit(SUN));
      gl.enable(gl.DEPTH_TEST); gl.enable(gl.SCISSOR_TEST);
      gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
      this.era++;   // the meshes' buffers are gone
    }

    bind(mesh) {
      const {gl} = this;
      if (!mesh.buffer || mesh.era !== this.era) { mesh.buffer = gl.createBuffer(); mesh.era = this.era; mesh.sent = -1; }
      gl.bindBuffer(gl.ARRAY_BUFFER, mesh.buffer);
      if (mesh.sent !== mesh.values.length) { gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(mesh.values), gl.DYNAMIC_DRAW); mesh.sent = mesh.values.length; }
      for (let k = 0; k < 3; k++) { gl.enableVertexAttribArray(k); gl.vertexAttribPointer(k, 3, gl.FLOAT, false, 4 * FLOATS, 12 * k); }
    }

    draw(items, eye, box, back) {
      const {gl} = this, bottom = this.canvas.height - box.top - box.height;
      gl.viewport(box.left, bottom, box.width, box.height);
      gl.scissor(box.left, bottom, box.width, box.height);
      gl.clearColor(...back, 1);
      gl.depthMask(true);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      gl.uniformMatrix4fv(this.at.view, false, eye.matrix);
      gl.uniform3fv(this.at.eye, eye.eye);
      const rank = one => (one.over ? 2 : (one.alpha ?? 1) < 1 ? 1 : 0);
      for (const one of [...items].sort((a, b) => rank(a) - rank(b))) {
        const {mesh, tint, alpha = 1, lit = true} = one, count = Math.min(one.count ?? mesh.count, mesh.count);
        if (!count) continue;
        this.bind(mesh);
        gl.uniformMatrix4fv(this.at.at, false, one.at || IDENTITY);
        gl.uniform4f(this.at.tint, ...(tint || [1, 1, 1]), alpha);
        gl.uniform1f(this.at.own, tint ? 0 : 1);
        gl.uniform1f(this.at.lit, lit && !mesh.lines ? 1 : 0);
        gl[alpha < 1 ? "enable" : "disable"](gl.BLEND);
        gl.depthMask(alpha >= 1);
        if (one.over) gl.clear(gl.DEPTH_BUFFER_BIT);
        gl[one.lift ? "enable" : "disable"](gl.POLYGON_OFFSET_FILL);
        gl.polygonOffset(-4, -8);
        gl.drawArrays(mesh.lines ? gl.LINES : gl.TRIANGLES, 0, count);
      }
    }
  }

  class Plain {   // the painter's algorithm
    constructor(canvas) { this.kind = "plain"; this.canvas = canvas; this.ctx = canvas.getContext("2d"); }

    draw(items, eye, box, back) {
      const {ctx} = this, faces = [], rgb = (c, a) => `rgba(${c.map(one => Math.round(255 * Math.min(one, 1))).join()},${a})`;
      ctx.save();
      ctx.beginPath(); ctx.rect(box.left, box.top, box.width, box.height); ctx.clip();
      ctx.fillStyle = rgb(back, 1);
      ctx.fillRect(box.left, box.top, box.width, box.height);
      for (const one of items) {
        const {mesh, tint, alpha = 1, lit = true} = one, corners = mesh.lines ? 2 : 3, count = Math.min(one.count ?? mesh.count, mesh.count);
        const read = k => mesh.values.slice(FLOATS * k, FLOATS * (k + 1)), at = one.at || IDENTITY;
        for (let k = 0; k + corners <= count; k += corners) {
          const all = Array.from({length: corners}, (_, m) => read(k + m)), places = all.map(v => point(at, v));
          const px = places.map(p => projected(eye, p, box));
          if (px.some(p => p.depth < eye.distance * 0.08)) continue;
          let n = unit(vector(at, all[0].slice(3, 6)));
          if (dot(n, minus(eye.eye, places[0])) < 0) n = n.map(v => -v);
          const day = lit && !mesh.lines ? 0.60 + 0.14 * n[2] + 0.32 * Math.max(dot(n, unit(SUN)), 0) : 1;
          const depth = px.reduce((sum, p) => sum + p.depth, 0) / corners - (one.over || 0) * 1e6;
          faces.push({px, depth, colour: rgb((tint || all[0].slice(6)).map(v => v * day), alpha), lines: mesh.lines, layer: one.layer ?? 9});
        }
      }
      ctx.lineWidth = 1; ctx.lineJoin = "round";
      for (const {px, colour, lines} of faces.sort((a, b) => a.layer - b.layer || b.depth - a.depth)) {
        ctx.beginPath();
        px.forEach((p, k) => (k ? ctx.lineTo(p.x, p.y) : ctx.moveTo(p.x, p.y)));
        ctx.fillStyle = ctx.strokeStyle = colour;
        if (!lines) { ctx.closePath(); ctx.fill(); }
        ctx.stroke();
      }
      ctx.restore();
    }
  }

  function isSoftware() {   // whether a processor draws: smooth edges then cost as much as everything else
    const gl = document.createElement("canvas").getContext("webgl"), info = gl && gl.getExtension("WEBGL_debug_renderer_info");
    const name = gl ? gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER) : "";
    if (gl) gl.getExtension("WEBGL_lose_context")?.loseContext();
    return /swiftshader|llvmpipe|software|basic render/i.test(name);
  }

  function open(canvas, plain) {
    const software = !plain && isSoftware(), options = {antialias: !software, alpha: false, preserveDrawingBuffer: true};
    const gl = plain ? null : canvas.getContext("webgl2", options) || canvas.getContext("webgl", options);
    return Object.assign(gl ? new Webgl(canvas, gl) : new Plain(canvas), {software});
  }

  return {open, Mesh, IDENTITY, plus, minus, dot, cross, size, unit, aside, times, point, vector, posed, turned, along, camera, projected};
})();
