#version 330 core
// Geometry patches of Doellner's approximation tree: an index is the number of a post in the padded grid, and a bit of
// it marks the foot of a wall between patches. There are no vertex attributes.
#include "lib/frame.glsl"
#include "lib/surface.glsl"
#include "lib/emit.glsl"

uniform int u_row_length;   // posts to a row of the padded grid
uniform int u_stride;       // the grid's posts are every u_stride-th of the terrain's
uniform vec3 u_chosen_eye;  // the eye the patches were chosen for, relative to the eye [m]
uniform vec2 u_wall;        // depth of walls: x times the distance to u_chosen_eye, plus y [m]
uniform float u_level;      // for the levels view

const int FOOT = 1 << 30;

void main() {
    int number = gl_VertexID & (FOOT - 1);
    ivec2 post = ivec2(number % u_row_length, number / u_row_length) * u_stride;
    vec3 position = position_of(vec2(post), post_height(post));
    if ((gl_VertexID & FOOT) != 0) position.y -= u_wall.x * distance(position, u_chosen_eye) + u_wall.y;
    emit_surface(position, vec2(post), u_level);
}
