"""What the ground is covered with: height and light of the terrain itself, images, themes, layers."""
