"""Cameras and spheres: geometry without a simulator, a robot or an image."""
