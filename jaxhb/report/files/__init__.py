"""Answers for programs: JSON, CSV and NetCDF files, which appear whole or not at all."""
