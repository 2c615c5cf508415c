#version 330 core
// One texel of a mip level from the level above, the only one that can be read (terrain/gpu/mipmaps.py).
uniform sampler2D u_source;
uniform vec2 u_size;  // of the level that is written [texels]
out vec4 out_colour;

void main() {
    out_colour = textureLod(u_source, gl_FragCoord.xy / u_size, 0.0);
}
