"""A surface whose heights come from a grey image or from a section of an STL file."""
