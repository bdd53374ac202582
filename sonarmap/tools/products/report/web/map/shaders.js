// What the graphics card runs.

// A point: whole numbers of a quantum from its tile's corner, and a color of the palette.
const POINT_VERTEX = `#version 300 es
in vec4 place;
uniform mat4 clip_from_target;
uniform vec3 corner;        // of the tile, less the target [m]
uniform float quantum;      // [m]
uniform float edge;         // of a voxel at a distance of 1 m [pixels of the card]
uniform vec2 sizes;         // smallest and largest edge [pixels of the card]
uniform vec2 heights;       // of the points that are shown, less the target's [m]
uniform sampler2D palette;
out vec3 color;
void main() {
  float height = corner.z + quantum * place.z;
  if (height < heights.x || height > heights.y) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); return; }
  gl_Position = clip_from_target * vec4(corner + quantum * place.xyz, 1.0);
  gl_PointSize = clamp(edge / gl_Position.w, sizes.x, sizes.y);
  color = texelFetch(palette, ivec2(int(place.w), 0), 0).rgb;
}`;

const POINT_FRAGMENT = `#version 300 es
precision mediump float;
in vec3 color;
out vec4 pixel;
void main() { pixel = vec4(color, 1.0); }`;

// A piece of a line as a rectangle, of which each corner has both ends: WebGL's own lines are one pixel wide.
const LINE_VERTEX = `#version 300 es
in vec3 begin;
in vec3 end;
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
  bool last = gl_VertexID % 4 > 1;
  vec4 place = last ? b : a;
  float side = gl_VertexID % 2 == 0 ? -0.5 : 0.5;
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
