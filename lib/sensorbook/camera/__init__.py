"""Attitude from images: the camera, scenes, the limb, ellipses and the baseline chain."""
