// What slices are made of: one record per box, and one word that names a slice; terrain/renderers/slicing_bundles.py
// writes both. Vertex stage; include after lib/frame.glsl.
uniform sampler2D u_extra0;  // two texels per box, RECORDS_PER_ROW boxes per row

const int RECORDS_PER_ROW = 256;
const float AXIS_STEP = 1024.0;  // the axis is kept with the number of planes, as so many times this
const uint BOX_BITS = 20u, LAST_NUMBER = 4095u;  // box in the low bits of the word, number of the plane above
const uint FACES = 6u;                           // numbers from the last one down are the box's own faces

struct Bundle {
    vec3 lower, upper;  // the box, relative to the eye [m]
    float count;        // planes
    float border;       // by how much slices reach over the box on every side [m]
    int axis;           // 0: planes across x, 1: y, 2: z
    float near, far;    // from the box's near face to a border behind the far one, along the axis [m]
};

Bundle bundle_of(uint name) {
    int box = int(name & ((1u << BOX_BITS) - 1u));
    ivec2 texel = ivec2(2 * (box % RECORDS_PER_ROW), box / RECORDS_PER_ROW);
    vec4 lower = texelFetch(u_extra0, texel, 0), upper = texelFetch(u_extra0, texel + ivec2(1, 0), 0);
    float axis = floor(lower.w / AXIS_STEP), count = lower.w - axis * AXIS_STEP;
    float low = axis == 0.0 ? lower.x : axis == 1.0 ? lower.y : lower.z;
    float high = axis == 0.0 ? upper.x : axis == 1.0 ? upper.y : upper.z;
    bool is_ahead = abs(low) < abs(high);
    float near = is_ahead ? low : high, far = is_ahead ? high + upper.w : low - upper.w;
    return Bundle(lower.xyz, upper.xyz, count, upper.w, int(axis), near, far);
}

// The plane of a slice: its axis and where it stands on it. Faces come in the order x low, x high, y low ... z high.
void plane_of(Bundle bundle, uint name, out int axis, out float plane) {
    uint number = name >> BOX_BITS, face = LAST_NUMBER - number;
    if (face < FACES) {
        axis = int(face >> 1u);
        plane = (face & 1u) == 1u ? bundle.upper[axis] + bundle.border : bundle.lower[axis] - bundle.border;
    } else {
        axis = bundle.axis;
        plane = mix(bundle.near, bundle.far, (float(number) + 1.0) / bundle.count);
    }
}
