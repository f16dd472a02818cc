"""The parts of a scene: geoms, props, flexes and skins, each as shapes that move."""
