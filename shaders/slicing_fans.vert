#version 330 core
// Polygon boxes: tiles of triangle fans, one instance per tile, heights fetched by vertex number.
#include "lib/frame.glsl"
#include "lib/surface.glsl"
#include "lib/fans.glsl"
#include "lib/emit.glsl"

void main() {
    ivec2 post = tile_post();
    emit_surface(position_of(vec2(post), post_height(post)), vec2(post), 0.0);
}
