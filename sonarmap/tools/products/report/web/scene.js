// What the graphics card runs.

// A point of a tile, which has a place and a turn of its own, and a color of the palette.
const POINT_VERTEX = `#version 300 es
layout(location = 0) in vec3 place;  // [quanta], in the frame of the tile
layout(location = 1) in float texel; // of the palette; below zero for that of the height
uniform mat4 clip_from_target;
uniform vec4 turn;          // of the tile, a quaternion x, y, z, w
uniform vec3 corner;        // of the tile, less the target [m]
uniform float quantum;      // [m]
uniform float edge;         // of a point at a distance of 1 m [pixels of the card]
uniform vec2 sizes;         // smallest and largest edge [pixels of the card]
uniform vec2 heights;       // of the points that are shown, less the target's [m]
uniform vec2 range;         // heights or distances at the ends of the palette; heights less the target's [m]
uniform vec4 from;          // place that distances are measured from, less the target [m], and 1; 0 for colors by height
uniform sampler2D palette;
out vec3 color;
void main() {
  vec3 own = quantum * place;
  vec3 at = own + 2.0 * cross(turn.xyz, cross(turn.xyz, own) + turn.w * own) + corner;
  if (at.z < heights.x || at.z > heights.y) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); return; }
  gl_Position = clip_from_target * vec4(at, 1.0);
  gl_PointSize = clamp(edge / gl_Position.w, sizes.x, sizes.y);
  float value = from.w > 0.0 ? length(at - from.xyz) : at.z;
  float share = clamp((value - range.x) / max(range.y - range.x, 1e-6), 0.0, 1.0);
  color = texelFetch(palette, ivec2(int(texel < 0.0 ? 254.0 * share + 0.5 : texel), 0), 0).rgb;
}`;

const POINT_FRAGMENT = `#version 300 es
precision mediump float;
in vec3 color;
out vec4 pixel;
void main() { pixel = vec4(color, 1.0); }`;

// Eye-dome lighting (Boucheny 2009): a pixel is darker where its neighbors are nearer, so shapes show without normals.
const SHADE_VERTEX = `#version 300 es
void main() { gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0); }`;

const SHADE_FRAGMENT = `#version 300 es
precision highp float;
uniform highp sampler2D colors;
uniform highp sampler2D depths;
uniform float farthest;     // a of the camera's depth
uniform int apart;          // from a pixel to its neighbors [pixels of the card]
uniform float strength;
out vec4 pixel;
const ivec2 AROUND[8] = ivec2[](ivec2(1, 0), ivec2(1, 1), ivec2(0, 1), ivec2(-1, 1), ivec2(-1, 0), ivec2(-1, -1), ivec2(0, -1), ivec2(1, -1));
float depthAt(ivec2 at) { return texelFetch(depths, clamp(at, ivec2(0), textureSize(depths, 0) - 1), 0).r; }
void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  gl_FragDepth = depthAt(at);
  pixel = texelFetch(colors, at, 0);
  if (gl_FragDepth == 1.0) return;
  float here = farthest + 1.0 - 2.0 * gl_FragDepth, shade = 0.0;  // over that of a neighbor: its distance over this one
  for (int k = 0; k < 8; k++) shade += clamp(1.0 - here / (farthest + 1.0 - 2.0 * depthAt(at + apart * AROUND[k])), 0.0, 0.07);
  pixel.rgb *= exp(-strength * shade);
}`;

// A piece of a line as a rectangle, of which each corner has both ends: WebGL's own lines are one pixel wide.
const LINE_VERTEX = `#version 300 es
layout(location = 0) in vec3 begin;
layout(location = 1) in vec3 end;
uniform mat4 clip_from_target;
uniform vec3 offset;        // of the lines' frame, less the target [m]
uniform vec2 size;          // of the picture [pixels of the card]
uniform float width;        // [pixels of the card]
out float along;            // [pixels of the card]
void main() {
  vec4 a = clip_from_target * vec4(begin + offset, 1.0);
  vec4 b = clip_from_target * vec4(end + offset, 1.0);
  float least = 1e-4 * max(abs(a.w), abs(b.w));
  if (a.w < least && b.w < least) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); along = 0.0; return; }
  if (a.w < least) a = mix(a, b, (least - a.w) / (b.w - a.w));  // cut off what is behind the camera
  if (b.w < least) b = mix(b, a, (least - b.w) / (a.w - b.w));
  vec2 from = a.xy / a.w * size / 2.0, to = b.xy / b.w * size / 2.0;
  float far = length(to - from);
  vec2 ahead = far > 0.0 ? (to - from) / far : vec2(1.0, 0.0);
  int corner = gl_VertexID % 6;  // of two triangles
  bool last = corner > 2 ? corner != 4 : corner == 2;
  vec4 place = last ? b : a;
  float side = corner == 1 || corner > 3 ? 0.5 : -0.5;
  place.xy += vec2(-ahead.y, ahead.x) * side * width / size * 2.0 * place.w;
  gl_Position = place;
  along = last ? far : 0.0;
}`;

const LINE_FRAGMENT = `#version 300 es
precision mediump float;
in float along;
uniform vec4 color;
uniform float dash;         // length of a dash and of a gap [pixels of the card]; 0 for none
out vec4 pixel;
void main() {
  if (dash > 0.0 && mod(along, 2.0 * dash) > dash) discard;
  pixel = color;
}`;

// What is drawn, by WebGL2: points of tiles, and lines of several kinds.

const BYTES = 6; // of a point: x, y and z, two each
const [PLACE, TEXEL] = [0, 1], [BEGIN, END] = [0, 1]; // attributes of POINT_VERTEX, and of LINE_VERTEX
const BY_HEIGHT = -1; // texel of a point that has the color of its height
const GROWTH = 0.3; // of points of which fewer are drawn: by 0.5 they would cover as much
const SQUARES = [1.5, 24]; // smallest and largest edge of a point [pixels]
const FAR = 1e9; // beyond any height [m]: not every card knows infinity
const HIDDEN = 0.22; // how opaque a line is behind points
const STRENGTH = 3.5; // of the shades of eye-dome lighting

class Scene {
  /** Of a canvas on which WebGL2 works; throws an Error otherwise. The palette is of colors [red, green, blue], 0 to 255. */
  constructor(canvas, palette) {
    const gl = canvas.getContext("webgl2", { antialias: false, alpha: false, powerPreference: "high-performance" });
    if (!gl) throw new Error("WebGL2 is not to be had; this browser, or this machine's graphics driver, does not offer it");
    this.gl = gl;
    this.clouds = new Map(); // {name: {points, buffer, colors: buffer or null}}
    this.lines = new Map(); // {name: {count, offset, buffer, and its style}}
    this.pointProgram = this.program(POINT_VERTEX, POINT_FRAGMENT);
    this.lineProgram = this.program(LINE_VERTEX, LINE_FRAGMENT);
    this.shadeProgram = this.program(SHADE_VERTEX, SHADE_FRAGMENT);
    [this.palette, this.colors, this.depths] = [0, 1, 2].map(() => gl.createTexture());
    this.frame = gl.createFramebuffer();
    const texels = new Uint8Array(palette.flatMap((color) => [...color, 255]));
    this.fill(this.palette, gl.RGBA8, palette.length, 1, gl.RGBA, gl.UNSIGNED_BYTE, texels);
    gl.enable(gl.DEPTH_TEST);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  }

  program(vertex, fragment) {
    const { gl } = this, program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    const names = Array.from({ length: gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS) }, (_, k) => gl.getActiveUniform(program, k).name);
    return { program, uniforms: Object.fromEntries(names.map((name) => [name, gl.getUniformLocation(program, name)])) };
  }

  /** A buffer of the card with these numbers: the old one, if there is one. */
  bufferOf(numbers, old) {
    const { gl } = this, buffer = old ?? gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, numbers, gl.STATIC_DRAW);
    return buffer;
  }

  /** Show points {places: x, y, z of each [quanta], quantum [m]} under a name, in place of those that it had; their colors are set anew. */
  showPoints(name, points) {
    const old = this.clouds.get(name);
    this.clouds.set(name, { ...old, points, buffer: this.bufferOf(points.places, old?.buffer) });
  }

  /** Color the points of a name by these texels (Uint8Array), or null: by their heights. */
  colorPoints(name, texels) {
    const cloud = this.clouds.get(name);
    cloud.colors = texels && this.bufferOf(texels, cloud.colors);
  }

  /** Fill a texture with texels, or with nothing yet, that are taken as they are. */
  fill(texture, inside, width, height, format, type, texels) {
    const { gl } = this;
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, inside, width, height, 0, format, type, texels);
    for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, filter, gl.NEAREST);
  }

  /** Lines [[begin, end], ...] [m] under a name: {color: [r, g, b] 0 to 1, width and dash [pixels], hidden: opacity behind points}. */
  showLines(name, pieces, style) {
    const offset = pieces.length ? pieces[0][0] : [0, 0, 0];
    const numbers = new Float32Array(36 * pieces.length); // both ends at each corner of two triangles: far faster than instances
    pieces.forEach((ends, k) => {
      const both = ends.flatMap((end) => minus(end, offset));
      for (let corner = 0; corner < 6; corner++) numbers.set(both, 36 * k + 6 * corner);
    });
    this.lines.set(name, { count: pieces.length, offset, buffer: this.bufferOf(numbers, this.lines.get(name)?.buffer), ...style });
  }

  /**
   * Add a slice of the points to the picture, which begins anew with slice 0: {ground: [r, g, b] 0 to 1, clouds: those to draw, of
   * which a `whole` one comes with the last slice, voxel: its edge [m], slices: number of those that hold all points, groups: of
   * clouds, of which a slice has one, alone: whether it is the only slice, ratio: pixels of the picture to one of the page, heights:
   * the lowest and the highest that are shown [m], range: heights at the ends of the palette [m], or distances from the place `from`}.
   */
  gather(camera, look, slice) {
    const { gl } = this, size = [camera.width, camera.height].map((edge) => Math.round(edge * look.ratio));
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
    if (`${size}` !== `${this.size}`) {
      this.fill(this.colors, gl.RGBA8, ...size, gl.RGBA, gl.UNSIGNED_BYTE, null);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.colors, 0);
      this.fill(this.depths, gl.DEPTH_COMPONENT24, ...size, gl.DEPTH_COMPONENT, gl.UNSIGNED_INT, null);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, this.depths, 0);
      this.size = size;
    }
    gl.viewport(0, 0, ...size);
    gl.clearColor(...look.ground, 1);
    if (slice === 0) gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    this.drawClouds(camera, look, slice);
  }

  /** Bring the picture to the canvas, its depths too, shaded and with the lines. */
  show(camera, { ratio }) {
    const { gl, size: [width, height] } = this;
    if (gl.canvas.width !== width || gl.canvas.height !== height) Object.assign(gl.canvas, { width, height });
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, width, height);
    this.shade(camera, ratio);
    for (const lines of this.lines.values()) if (lines.count) this.drawLines(lines, camera, ratio);
  }

  shade(camera, ratio) {
    const { gl } = this, { program, uniforms } = this.shadeProgram;
    gl.useProgram(program);
    [this.colors, this.depths].forEach((texture, unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, texture);
    });
    gl.activeTexture(gl.TEXTURE0);
    gl.uniform1i(uniforms.depths, 1);
    gl.uniform1f(uniforms.farthest, camera.planes()[0]);
    gl.uniform1i(uniforms.apart, Math.ceil(ratio));
    gl.uniform1f(uniforms.strength, STRENGTH);
    gl.depthFunc(gl.ALWAYS);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.depthFunc(gl.LEQUAL);
  }

  drawClouds(camera, look, slice) {
    const { gl } = this, { program, uniforms } = this.pointProgram;
    const lessTarget = (heights) => heights.map((height) => Math.max(-FAR, Math.min(FAR, height - camera.target[2])));
    gl.useProgram(program);
    gl.uniformMatrix4fv(uniforms.clip_from_target, false, camera.matrix());
    gl.uniform2fv(uniforms.heights, lessTarget(look.heights));
    gl.uniform2fv(uniforms.range, look.from ? look.range : lessTarget(look.range));
    gl.uniform4f(uniforms.from, ...(look.from ? [...minus(look.from, camera.target), 1] : [0, 0, 0, 0]));
    gl.bindTexture(gl.TEXTURE_2D, this.palette);
    const { alone, groups, slices } = look;
    look.clouds.forEach((cloud, k) => {
      if (cloud.whole && (alone || slice + 1 === slices)) this.drawCloud(cloud, camera, look, 0, 1);
      else if (!cloud.whole && k % groups === slice % groups) this.drawCloud(cloud, camera, look, Math.floor(slice / groups), slices / groups);
    });
  }

  /** Edge of a point's square at a distance of 1 m [pixels]. */
  edge(camera, voxel) {
    return (voxel * camera.height) / (2 * Math.tan(FIELD / 2));
  }

  /** Draw every so many points of the tiles [{start, count, origin [m], turn}] of a name; `texel` of points without own colors, `larger` by a factor. */
  drawCloud({ name, tiles, texel = BY_HEIGHT, larger = 1, whole }, camera, { alone, voxel, ratio, slices }, first, step) {
    const { gl } = this, { uniforms } = this.pointProgram;
    const { points: { places, quantum }, buffer, colors } = this.clouds.get(name);
    const type = places instanceof Int16Array ? gl.SHORT : gl.UNSIGNED_SHORT;
    gl.uniform1f(uniforms.quantum, quantum);
    gl.uniform1f(uniforms.edge, this.edge(camera, larger * voxel) * ratio * (alone && !whole ? slices ** GROWTH : 1));
    gl.uniform2f(uniforms.sizes, ...SQUARES.map((size) => larger * size * ratio));
    gl.enableVertexAttribArray(PLACE);
    gl[colors ? "enableVertexAttribArray" : "disableVertexAttribArray"](TEXEL);
    gl.vertexAttrib1f(TEXEL, texel);
    for (const { start, count, origin, turn } of tiles) {
      gl.uniform4fv(uniforms.turn, turn);
      gl.uniform3fv(uniforms.corner, minus(origin, camera.target));
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.vertexAttribPointer(PLACE, 3, type, false, BYTES * step, BYTES * (start + first));
      if (colors) {
        gl.bindBuffer(gl.ARRAY_BUFFER, colors);
        gl.vertexAttribPointer(TEXEL, 1, gl.UNSIGNED_BYTE, false, step, start + first);
      }
      gl.drawArrays(gl.POINTS, 0, Math.max(0, Math.ceil((count - first) / step)));
    }
  }

  /** Draw lines, and faintly what points hide of them. */
  drawLines(lines, camera, ratio) {
    const { gl } = this, { program, uniforms } = this.lineProgram;
    gl.useProgram(program);
    gl.uniformMatrix4fv(uniforms.clip_from_target, false, camera.matrix());
    gl.uniform3fv(uniforms.offset, minus(lines.offset, camera.target));
    gl.uniform2f(uniforms.size, gl.canvas.width, gl.canvas.height);
    gl.uniform1f(uniforms.width, lines.width * ratio);
    gl.uniform1f(uniforms.dash, (lines.dash ?? 0) * ratio);
    gl.bindBuffer(gl.ARRAY_BUFFER, lines.buffer);
    for (const end of [BEGIN, END]) {
      gl.enableVertexAttribArray(end);
      gl.vertexAttribPointer(end, 3, gl.FLOAT, false, 24, 12 * end);
    }
    gl.enable(gl.BLEND);
    gl.depthMask(false);
    for (const [compare, alpha] of [[gl.LEQUAL, 1], [gl.GREATER, lines.hidden ?? HIDDEN]]) {
      gl.depthFunc(compare);
      gl.uniform4f(uniforms.color, ...lines.color, alpha);
      gl.drawArrays(gl.TRIANGLES, 0, 6 * lines.count);
    }
    gl.depthFunc(gl.LEQUAL);
    gl.depthMask(true);
    gl.disable(gl.BLEND);
  }
}
