#version 330 core
// The part of the picture that a perturbed base plane can fill: a rectangle.
// Source: S. I. Vyatkin, S. V. Pavlov, S. A. Romanyuk, "Real-time hybrid terrain rendering".
uniform vec4 u_rectangle;  // clip coordinates: left, bottom, right, top
out vec2 v_screen;         // 0..1, origin at the lower left

void main() {
    vec2 corner = mix(u_rectangle.xy, u_rectangle.zw, vec2(gl_VertexID & 1, gl_VertexID >> 1));
    v_screen = 0.5 + 0.5 * corner;
    gl_Position = vec4(corner, 0.5, 1.0);
}
