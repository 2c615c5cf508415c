#version 330 core
// Rectangles of the picture that hold slices: one instance each.
in vec4 in_patch;  // low corner, high corner; 0..1, origin at the lower left
out vec2 v_screen;

void main() {
    v_screen = vec2((gl_VertexID & 1) == 0 ? in_patch.x : in_patch.z, gl_VertexID < 2 ? in_patch.y : in_patch.w);
    gl_Position = vec4(v_screen * 2.0 - 1.0, 0.0, 1.0);
}
