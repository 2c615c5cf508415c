#version 330 core
// A square around the sun's disc, at the far end of depth.
#include "lib/frame.glsl"

out vec3 v_ray;

const float REACH = 0.016;  // tangent of an angle a little larger than the disc's radius

void main() {
    vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
    vec3 side = normalize(abs(u_sun.y) < 0.9 ? vec3(-u_sun.z, 0.0, u_sun.x) : vec3(0.0, u_sun.z, -u_sun.y));
    v_ray = u_sun.xyz + REACH * (corner.x * side + corner.y * cross(side, u_sun.xyz));
    gl_Position = u_clip_from_eye * vec4(v_ray, 0.0);
#ifdef LOG_DEPTH
    gl_Position.z = -gl_Position.w;  // clip volume -1..1: depth 0
#else
    gl_Position.z = 0.0;
#endif
}
