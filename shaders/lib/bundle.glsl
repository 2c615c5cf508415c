// The planes of a bundle along a sight ray, by view depth t [m]. Fragment stage; include after lib/packed.glsl.
// Lengths are posts across x and z, metres across y, as in sight_along.
flat in vec4 v_planes;  // distance of the first plane's predecessor, then of planes; its inverse; the axis
flat in vec3 v_enter;   // the faces through which rays enter the box, from the eye; 0 where there is none
uniform float u_planes_per_slice;

struct Planes {
    float step;    // from plane to plane
    float before;  // the plane before the first, or where the ray enters the box
    float end;     // where it meets the slice or face that is drawn
    float first;   // the first plane after the slice before, and in the box
};

const float SAME = 0.01;  // of a step: planes nearer than this to a slice are the slice

Planes planes_along(vec3 sight) {
    vec3 per_length = 1.0 / (sight + 1e-20);  // no ray is quite parallel to a face
    bool is_x = v_planes.w == 0.0, is_y = v_planes.w == 1.0;
    float along = is_x ? sight.x : is_y ? sight.y : sight.z;
    float per_along = is_x ? per_length.x : is_y ? per_length.y : per_length.z;
    float near = v_planes.x * per_along, step = v_planes.y * per_along, per_step = v_planes.z * along;
    float end = 1.0 / gl_FragCoord.w;
    vec3 enter = v_enter * per_length;
    float entry = clamp(max(max(enter.x, enter.y), enter.z), 0.0, end);
    float slices = ((end - near) * per_step - SAME) / u_planes_per_slice;
    float first = max((ceil(slices) - 1.0) * u_planes_per_slice + 1.0, ceil((entry - near) * per_step));
    first = near + first * step;
    return Planes(step, clamp(first - step, entry, end), end, first);
}
