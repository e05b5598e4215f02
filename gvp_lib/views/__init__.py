"""What a reader looks at: 3D scenes and figures. Nothing imports this room."""
