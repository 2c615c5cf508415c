// The surface by one fetch per point: u_packed holds, for every cell, its four corner heights (nw, ne, sw, se).
// Include after lib/frame.glsl and lib/surface.glsl.
uniform sampler2D u_packed;  // RGBA32F, one texel per cell

// Fractional posts from the post north-west of the eye: small numbers, so that float32 resolves a cell near the eye.
vec2 posts_from_eye(vec3 position_m) {
    return (position_m.xz + u_eye_post.zw) / u_grid.zw;
}

// How deep [m] a point relative to the eye lies in the ground; past the grid's edges their heights go on.
float depth_in_ground(vec3 position_m) {
    vec2 posts = posts_from_eye(position_m);
    vec2 cell = clamp(u_eye_post.xy + floor(posts), vec2(0.0), u_grid.xy - 2.0);
    vec2 uv = clamp(posts + (u_eye_post.xy - cell), 0.0, 1.0);
    float height_m = cell_height(texelFetch(u_packed, ivec2(cell), 0), uv, is_nw_se(ivec2(cell)));
    return height_from_eye(height_m) - position_m.y;
}
