#version 330 core
// Signed distance of the drawn surface to the reference surface, first order, in pixels: K * delta * n_y / l.
// Twin of terrain/measure/accuracy.py: geometric_error_px. Posts are counted from the eye and heights taken relative to
// it, so that float32 stays as precise near the eye as the picture itself.
#include "lib/frame.glsl"
#include "lib/surface.glsl"

// Corners of triangles are rounded to 1/256 px, so that pixel centres may lie half as much outside their triangle. Seen edge
// on, that shifts a point far along the sight ray, past the triangle's end; the shift is subtracted from the error. Where
// drawn and reference surface are about parallel it amounts to 1/256 px at most. A triangle that runs through its whole distance
// within one pixel has no point that could be measured: its error counts as 0.
const float RASTER_ROUNDING_PX = 1.0 / 512.0;

uniform sampler2D u_extra0;       // positions relative to the eye; w: 0 uncovered, else 1 + metres moved across a pixel
uniform int u_uniform_diagonals;  // the rule the renderer promises: 1 uniform, 0 alternating
out vec4 out_colour;              // x: error [px]; y: vertical error [m]; z: distance [m]; w: 1 where covered

void main() {
    vec4 position_m = texelFetch(u_extra0, ivec2(gl_FragCoord.xy), 0);
    if (position_m.w < 0.5) {
        out_colour = vec4(0.0);
        return;
    }
    vec2 local = (position_m.xz + u_eye_post.zw) / u_grid.zw;  // posts from the post north-west of the eye
    ivec2 eye = ivec2(u_eye_post.xy);
    ivec2 cell = clamp(ivec2(floor(local)) + eye, ivec2(0), ivec2(u_grid.xy) - 2);
    vec2 uv = local - vec2(cell - eye);
    vec4 corner = cell_corners(cell);
    corner = vec4(height_from_eye(corner.x), height_from_eye(corner.y), height_from_eye(corner.z), height_from_eye(corner.w));
    bool nw_se = u_uniform_diagonals == 0 && is_nw_se(cell);
    float delta_m = position_m.y - cell_height(corner, uv, nw_se);
    // Slopes of the triangle (nw, ne, sw, se are corner.xyzw).
    bool north = nw_se ? uv.x >= uv.y : uv.x + uv.y <= 1.0;
    vec2 rise = nw_se ? (north ? vec2(corner.y - corner.x, corner.w - corner.y) : vec2(corner.w - corner.z, corner.z - corner.x))
                      : (north ? vec2(corner.y - corner.x, corner.z - corner.x) : vec2(corner.w - corner.z, corner.w - corner.y));
    vec2 slope = rise / u_grid.zw;
    float distance_m = length(position_m.xyz);
    vec3 normal = vec3(-slope.x, 1.0, -slope.y) * inversesqrt(1.0 + dot(slope, slope));
    float shift_m = (position_m.w - 1.0) * RASTER_ROUNDING_PX * abs(dot(normal, position_m.xyz)) / distance_m;
    bool edge_on = position_m.w - 1.0 > distance_m;
    delta_m = edge_on ? 0.0 : sign(delta_m) * max(abs(delta_m) - shift_m / normal.y, 0.0);
    out_colour = vec4(u_eye_height.w * delta_m * normal.y / distance_m, delta_m, distance_m, 1.0);
}
