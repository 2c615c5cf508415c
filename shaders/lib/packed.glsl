// The surface by one fetch per point. u_packed holds for every cell what its height is made of: with u eastwards and v
// southwards, h = x + y u + z v + w min(u, v), where u runs westwards in cells that are cut SW-NE
// (terrain/renderers/slicing_bundles.py: pack_cells). Include after lib/frame.glsl.
uniform sampler2D u_packed;  // RGBA32F, one texel per cell

// Fractional posts from the post north-west of the eye: small numbers, so that float32 resolves a cell near the eye.
vec2 posts_from_eye(vec3 position_m) {
    return (position_m.xz + u_eye_post.zw) / u_grid.zw;
}

// How deep [m] a point lies in the ground: `posts` from the eye, y_m above it; past the grid's edges their heights go on.
float depth_below(vec2 posts, float y_m) {
    vec2 cell = clamp(u_eye_post.xy + floor(posts), vec2(0.0), u_grid.xy - 2.0);
    vec2 uv = clamp(posts + (u_eye_post.xy - cell), 0.0, 1.0);
    float is_sw_ne = 2.0 * fract(0.5 * (cell.x + cell.y));
    uv.x = abs(is_sw_ne - uv.x);
    vec4 ground = texelFetch(u_packed, ivec2(cell), 0);
    return height_from_eye(ground.x + ground.y * uv.x + ground.z * uv.y + ground.w * min(uv.x, uv.y)) - y_m;
}

float depth_in_ground(vec3 position_m) {
    return depth_below(posts_from_eye(position_m), position_m.y);
}
