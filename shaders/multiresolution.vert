#version 330 core
// Geometry patches of Doellner's approximation tree: an index is the number of a post in the padded grid. There are no
// vertex attributes.
#include "lib/frame.glsl"
#include "lib/surface.glsl"
#include "lib/emit.glsl"

uniform int u_row_length;  // posts to a row of the padded grid
uniform int u_stride;      // the grid's posts are every u_stride-th of the terrain's
uniform float u_level;     // for the levels view

void main() {
    ivec2 post = ivec2(gl_VertexID % u_row_length, gl_VertexID / u_row_length) * u_stride;
    emit_surface(position_of(vec2(post), post_height(post)), vec2(post), u_level);
}
