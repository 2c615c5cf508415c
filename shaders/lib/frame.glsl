// The frame's uniform block; its CPU side is FRAME_DTYPE in terrain/gpu/frame_block.py.
layout(std140) uniform Frame {
    mat4 u_clip_from_eye;  // world axes, origin at the eye -> clip space; no translation
    vec4 u_eye_post;       // xy: the post north-west of the eye (col, row); zw: the eye east and south of it [m]
    vec4 u_eye_height;     // x + y: eye height [m] as two floats; z: near plane [m]; w: K, pixels per (size / distance)
    vec4 u_grid;           // xy: cols, rows; zw: post spacing dx, dz [m]
    vec4 u_viewport;       // xy: size [px]; zw: 1 / size
    vec4 u_ray[3];         // sight ray through the lower left corner, then its change across and up the picture (w: squared)
    vec4 u_axis;           // xy: where the sight line meets the picture, 0..1: in its middle, unless it is a tile
    vec4 u_sun;            // xyz: unit vector to the sun
    vec4 u_sunlight;       // rgb: light of the sun on a surface that faces it, linear
    vec4 u_sky_light;      // rgb: light of the whole sky, linear
    vec4 u_fog;            // x: density [1/m] at height y [m]; z: falloff with height [1/m]; w: density at the eye [1/m]
    vec4 u_fog_colour;     // haze below the horizon, display colours like the next two
    vec4 u_zenith;
    vec4 u_horizon;
    vec4 u_contour;        // x: interval [m]; y: every n-th is bold; z: line width [px]; w: exaggeration of heights
    vec4 u_water;          // x: level [m]; y: depth [m] at which water turns opaque
    vec4 u_layer_what[8];  // per layer, lowest first: its tree, the tree of the next key frame, that one's share, and the
                           // tree of its visibility texture (-1: none)
    vec4 u_layer_how[8];   // x: opacity; y: blend (lib/layers.glsl); z, w: weight outside and inside the lens
    vec4 u_lens;           // xy: centre, in coordinates of the ground textures; z: radius [m]; w: width of its rim [m]
    vec4 u_lens_effect;    // x: how much darker it is outside
};

// Height of a post relative to the eye [m]; the subtraction is exact where the two are close.
float height_from_eye(float height_m) {
    return (height_m - u_eye_height.x) - u_eye_height.y;
}

// Position relative to the eye [m] of a post at a height. Whole posts are subtracted exactly, so that whoever shares a
// post computes the same bits, and a northing of 6 million metres does not shake the picture.
vec3 position_of(vec2 post, float height_m) {
    vec2 xz = (post - u_eye_post.xy) * u_grid.zw - u_eye_post.zw;
    return vec3(xz.x, height_from_eye(height_m), xz.y);
}

// Fractional post (col, row) of a position relative to the eye: the inverse of position_of.
vec2 post_of(vec3 position_m) {
    return (position_m.xz + u_eye_post.zw) / u_grid.zw + u_eye_post.xy;
}

// Absolute height [m] of a point relative to the eye.
float height_of(float y_m) {
    return y_m + (u_eye_height.x + u_eye_height.y);
}

// Sight ray through a point of the picture (0..1, origin at the lower left), as long as its view depth is 1.
vec3 sight_ray(vec2 screen) {
    return u_ray[0].xyz + screen.x * u_ray[1].xyz + screen.y * u_ray[2].xyz;
}

// Length of that ray.
float sight_length(vec2 screen) {
    vec2 off = screen - u_axis.xy;
    return sqrt(1.0 + dot(off * off, vec2(u_ray[1].w, u_ray[2].w)));
}
