"""The solid that cannot be seen into: extinction of Gaussians, optical depth from outside, and votes on the solid."""
