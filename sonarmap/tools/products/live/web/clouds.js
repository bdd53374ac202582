// Every key scan's cloud in its own frame: when a loop closes, its pose changes, a uniform, and no point.

const CLOUD_VERTEX = `#version 300 es
in vec3 place;              // [quanta], in the sensor's frame of the key scan
uniform mat4 clip_from_target;
uniform vec4 turn;          // of the key scan, a quaternion x, y, z, w
uniform vec3 offset;        // of the key scan, less the target [m]
uniform float quantum;      // [m]
uniform float edge;         // of a point at a distance of 1 m [pixels of the card]
uniform vec2 sizes;         // smallest and largest edge [pixels of the card]
uniform vec2 heights;       // at the ends of the palette, less the target's [m]
uniform float texel;        // of all points; below zero for each its height's
uniform sampler2D palette;
out vec3 color;
void main() {
  vec3 own = quantum * place;
  vec3 at = own + 2.0 * cross(turn.xyz, cross(turn.xyz, own) + turn.w * own) + offset;
  gl_Position = clip_from_target * vec4(at, 1.0);
  gl_PointSize = clamp(edge / gl_Position.w, sizes.x, sizes.y);
  float share = clamp((at.z - heights.x) / max(heights.y - heights.x, 1e-6), 0.0, 1.0);
  color = texelFetch(palette, ivec2(int(texel < 0.0 ? 254.0 * share + 0.5 : texel), 0), 0).rgb;
}`;
const LAST_TEXEL = 256, LAST_COLOR = [255, 64, 176]; // behind the palette, of the last scan
const GROWTH = 0.3; // of points of which fewer are drawn: by 0.5 they would cover as much
const POINT_BYTES = 6; // x, y and z, two each

class CloudScene extends Scene {
  constructor(canvas) {
    super(canvas);
    this.cloudProgram = this.program(CLOUD_VERTEX, POINT_FRAGMENT);
    this.at = this.gl.getAttribLocation(this.cloudProgram.program, "place");
  }

  forget() {
    for (const { buffer } of this.clouds.values()) this.gl.deleteBuffer(buffer);
    this.clouds.clear();
  }

  /** `look` as the report's, with {poses, range: heights at the ends of the palette [m]}; the cloud "last" is drawn larger. */
  drawClouds(camera, matrix, look, ratio) {
    const { gl, at } = this, { uniforms, program } = this.cloudProgram;
    gl.useProgram(program);
    gl.uniformMatrix4fv(uniforms.clip_from_target, false, matrix);
    gl.uniform2f(uniforms.heights, ...look.range.map((height) => height - camera.target[2]));
    gl.bindTexture(gl.TEXTURE_2D, this.palette);
    for (const name of look.clouds) {
      const { points, buffer, array } = this.clouds.get(name), pose = look.poses[points.key];
      const [step, larger, texel] = name === "last" ? [1, 1.4, LAST_TEXEL] : [look.step, 1, -1];
      gl.uniform1f(uniforms.edge, this.edge(camera, look.voxel, larger) * ratio * step ** GROWTH);
      gl.uniform2f(uniforms.sizes, ...SQUARES.map((size) => larger * size * ratio));
      gl.uniform4fv(uniforms.turn, pose.turn);
      gl.uniform3fv(uniforms.offset, minus(pose.place, camera.target));
      gl.uniform1f(uniforms.quantum, points.quantum);
      gl.uniform1f(uniforms.texel, texel);
      gl.bindVertexArray(array);
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.enableVertexAttribArray(at);
      gl.vertexAttribPointer(at, 3, gl.SHORT, false, POINT_BYTES * step, 0);
      gl.drawArrays(gl.POINTS, 0, Math.ceil(points.count / step));
    }
    gl.bindVertexArray(null);
  }
}
