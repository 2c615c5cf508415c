#version 330 core
// One triangle that covers the screen, at the far end of depth: what is behind everything, or a pass over all pixels.
out vec2 v_screen;  // 0..1, origin at the lower left

void main() {
    v_screen = vec2((gl_VertexID & 1) * 2, (gl_VertexID >> 1) * 2);
#ifdef LOG_DEPTH
    const float far = -1.0;  // clip volume -1..1: depth 0
#else
    const float far = 0.0;  // clip volume 0..1: depth 0
#endif
    gl_Position = vec4(v_screen * 2.0 - 1.0, far, 1.0);
}
