"""Files to height fields, and back to GeoTIFF: any raster GDAL reads, images, arrays, bare numbers."""
