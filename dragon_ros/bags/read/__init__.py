"""Reading bags in bounded memory, damaged ones too."""
