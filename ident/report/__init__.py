"""Report pages: one self-contained HTML file with its figures, for every command that explains."""
