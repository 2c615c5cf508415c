// The look of the surface, shared by all renderers. Elevation tint times light is baked from the full-resolution
// terrain (bake_ground.frag), so that light does not change with the level of detail.
uniform sampler2D u_ground;

vec4 shade(vec3 position_m, vec2 ground) {
    vec4 colour = texture(u_ground, ground);
#ifdef HOLES
    if (colour.a < 0.5) discard;
#endif
    return vec4(colour.rgb, 1.0);
}
