"""Fourier-domain mathematics: arrays in, arrays out."""
