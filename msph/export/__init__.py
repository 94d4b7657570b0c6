"""Files of water and bodies for other programs: meshes, points, tables, USD."""
