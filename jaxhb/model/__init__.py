"""What the engineer describes: elements, drive trains, engines, scene files."""
