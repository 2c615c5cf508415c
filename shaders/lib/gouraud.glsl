// Vertex stage: light at a vertex, for multiresolution_gouraud.frag to interpolate; what Doellner's paper compares
// topographic textures with. Include after lib/frame.glsl and lib/surface.glsl.
#ifdef GOURAUD
out vec3 v_light;

const float AMBIENT = 0.25;

void emit_light(vec2 post) {
    ivec2 near = ivec2(post + 0.5);
    vec2 slope = vec2(post_height(near + ivec2(1, 0)) - post_height(near - ivec2(1, 0)),
                      post_height(near + ivec2(0, 1)) - post_height(near - ivec2(0, 1))) / (2.0 * u_grid.zw);
    vec3 normal = normalize(vec3(-slope.x, 1.0, -slope.y));
    v_light = vec3(AMBIENT + (1.0 - AMBIENT) * max(dot(normal, u_sun.xyz), 0.0));
}
#else
void emit_light(vec2 post) {}
#endif
