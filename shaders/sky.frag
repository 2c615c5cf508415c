#version 330 core
// The sky behind the terrain: colours of the vertex stage.
noperspective in vec3 v_colour;
out vec4 out_colour;

void main() {
    out_colour = vec4(v_colour, 1.0);
}
