#version 330 core
// Geometry patches of Doellner's approximation tree: an index is the number of a post in the padded grid or, behind all
// posts, that of a vertex of an imported line. There are no vertex attributes.
#include "lib/frame.glsl"
#include "lib/surface.glsl"
#include "lib/emit.glsl"
#include "lib/gouraud.glsl"

uniform int u_row_length;  // posts to a row of the padded grid
uniform int u_stride;      // the grid's posts are every u_stride-th of the terrain's
uniform float u_level;     // for the levels view

#ifdef BREAKLINES
uniform sampler2D u_extra0;  // xyz: column, row and height [m] of the lines' vertices, row by row
uniform int u_post_count;
#endif

void main() {
#ifdef BREAKLINES
    if (gl_VertexID >= u_post_count) {
        int vertex = gl_VertexID - u_post_count, width = textureSize(u_extra0, 0).x;
        vec3 place = texelFetch(u_extra0, ivec2(vertex % width, vertex / width), 0).xyz;
        emit_surface(position_of(place.xy, place.z), place.xy, u_level);
        emit_light(place.xy);
        return;
    }
#endif
    ivec2 post = ivec2(gl_VertexID % u_row_length, gl_VertexID / u_row_length) * u_stride;
    emit_surface(position_of(vec2(post), post_height(post)), vec2(post), u_level);
    emit_light(vec2(post));
}
