// Bars of a sight ray over the multilevel height map: rays in map coordinates, the planes that bound a node, and where a
// ray leaves a square. Include after lib/frame.glsl. Twin of terrain/algorithms/perturbation_cast.py.
//
// Map coordinates (u, v, h): columns, rows, metres along the base plane's normal. All are relative to the eye, whole
// cells apart, so that no digit is lost near it; t counts view depth [m].
uniform mat3 u_map_from_world;  // G = T M without its translation (equation 10)
uniform ivec2 u_cells;          // (cols, rows) of cells
uniform ivec2 u_eye_cell;       // the cell below the eye, also outside the map
uniform vec4 u_eye_map;         // xy: the eye in that cell; z + w: its height as two floats [m]
uniform vec2 u_range;           // lowest and highest the surface can be, relative to the eye [m]
uniform vec2 u_inwards;         // a hair's breadth towards the middle of the map: what an axis-parallel ray gets
uniform int u_top_level;        // nodes of 2^level cells

struct Bars {
    vec3 direction;  // per unit of t
    vec2 inverse;
    ivec2 ahead;     // 1 where the coordinate grows along the ray
};

Bars bars_along(vec3 world_direction) {
    vec3 d = u_map_from_world * world_direction;
    vec3 hair = vec3(u_inwards, -1e-20);
    d = mix(d, hair, lessThan(abs(d), vec3(1e-20)));
    return Bars(d, 1.0 / d.xy, ivec2(greaterThan(d.xy, vec2(0.0))));
}

// Where the ray is between the map's sides, and between its lowest and highest height.
vec2 clip_to_map(Bars bars) {
    vec2 west_north = vec2(-u_eye_cell) - u_eye_map.xy, east_south = vec2(u_cells - u_eye_cell) - u_eye_map.xy;
    vec3 a = vec3(west_north * bars.inverse, u_range.x / bars.direction.z);
    vec3 b = vec3(east_south * bars.inverse, u_range.y / bars.direction.z);
    vec3 enter = min(a, b), leave = max(a, b);
    return vec2(max(max(enter.x, enter.y), enter.z), min(min(leave.x, leave.y), leave.z));
}

// North-west corner of a square of cells, relative to the eye.
vec2 corner_from_eye(ivec2 cell) {
    return vec2(cell - u_eye_cell) - u_eye_map.xy;
}

// The cell at t, inside a square of `size` cells.
ivec2 cell_at(Bars bars, float t, ivec2 corner, int size) {
    ivec2 cell = u_eye_cell + ivec2(floor(u_eye_map.xy + bars.direction.xy * t));
    return clamp(cell, corner, min(corner + size, u_cells) - 1);
}

// Where the ray leaves a square, through its sides across (x) and along (y). Sides are whole cells: squares that share
// one compute the same t.
vec2 leave_square(Bars bars, ivec2 corner, int size) {
    return corner_from_eye(corner + bars.ahead * size) * bars.inverse;
}

// Height of the ray at t = 0 above the plane (a, b, height at the corner), and how that grows with t.
vec2 gap_to_plane(Bars bars, vec2 slope, float height_m, vec2 corner) {
    return vec2((u_eye_map.z - height_m) + u_eye_map.w + dot(slope, corner),
                bars.direction.z - dot(slope, bars.direction.xy));
}

// How the hit at t on a surface of a given slope moves over the map, in posts, from one pixel to the next: across the
// picture and up. The pixel beside may show another hill; the surface here says how its texture is to be filtered.
mat2 posts_per_pixel(Bars bars, vec2 slope, float t) {
    vec3 across = u_map_from_world * (u_ray[1].xyz * u_viewport.z), up = u_map_from_world * (u_ray[2].xyz * u_viewport.w);
    vec3 normal = vec3(-slope, 1.0);
    float facing = dot(normal, bars.direction);  // not below zero: a step between two nodes, which faces the eye
    vec2 recede = facing < 0.0 ? vec2(dot(normal, across), dot(normal, up)) / facing : vec2(0.0);
    return t * mat2(across.xy - bars.direction.xy * recede.x, up.xy - bars.direction.xy * recede.y);
}
