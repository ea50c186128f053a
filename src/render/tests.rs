//! Laws of the rasteriser.
