"""Gymnasium environments of the platform, and their top view."""
