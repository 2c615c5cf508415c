#version 330 core
// The sky as a grid of SKY_COLS x SKY_ROWS cells (terrain/textures/sky.py) at the far end of depth, one triangle strip per
// instance: its colours change slowly enough to be computed at the corners, and cost a software rasteriser far less there.
#include "lib/frame.glsl"
#include "lib/atmosphere.glsl"

noperspective out vec3 v_colour;  // as cheap as a varying can be

void main() {
    vec2 screen = vec2(float(gl_VertexID / 2) / SKY_COLS, (float(gl_InstanceID) + 1.0 - float(gl_VertexID & 1)) / SKY_ROWS);
    v_colour = sky_colour(normalize(sight_ray(screen)));
#ifdef LOG_DEPTH
    const float far = -1.0;  // clip volume -1..1: depth 0
#else
    const float far = 0.0;  // clip volume 0..1: depth 0
#endif
    // Top row of a strip first, so that its triangles face the viewer.
    gl_Position = vec4(screen * 2.0 - 1.0, far, 1.0);
}
