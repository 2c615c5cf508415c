#version 330 core
// Bounding boxes as lines, coloured by level: one instance per box, twelve edges of two triangles each.
#include "lib/frame.glsl"
#include "lib/line.glsl"

in vec3 in_lower_m;  // relative to the eye
in vec3 in_upper_m;
in float in_level;
uniform float u_line_width_px;
flat out float v_level;

void main() {
    int edge = gl_VertexID / 6, axis = edge >> 2;
    vec3 from = vec3(0.0);
    from[(axis + 1) % 3] = float(edge & 1);
    from[(axis + 2) % 3] = float((edge >> 1) & 1);
    vec3 to = from;
    to[axis] = 1.0;
    const int corner[6] = int[6](0, 1, 2, 2, 1, 3);
    emit_line(mix(in_lower_m, in_upper_m, from), mix(in_lower_m, in_upper_m, to), corner[gl_VertexID % 6],
              u_line_width_px);
    v_level = in_level;
}
