"""What a scene is put together from: geoms, props, flexes and skins, each as shapes that move."""
