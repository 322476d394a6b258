"""Features of solids with their widths: parts, tunnels and cavities, by persistent homology of the signed distance."""
