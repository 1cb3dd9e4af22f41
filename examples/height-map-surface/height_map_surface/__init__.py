"""Surface whose heights come from a greyscale image or from a section of an STL file."""
