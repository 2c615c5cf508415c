#version 330 core
// The shaded picture with light from the vertices, in place of mesh.frag.
#include "lib/frame.glsl"

in vec3 v_light;
#ifdef HOLES
in vec2 v_ground;
uniform sampler2D u_ground;  // alpha 0 where there is no data
#endif
out vec4 out_colour;

void main() {
#ifdef HOLES
    if (texture(u_ground, v_ground).a < 0.5) discard;
#endif
    out_colour = vec4(v_light, 1.0);
}
