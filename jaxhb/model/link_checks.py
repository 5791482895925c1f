"""Checks of what a link is given by: stiffness or dimensions, one kind of damping, what limits of strength need."""

from __future__ import annotations

from jaxhb.model.value_checks import number_like, shown

_UNITS = {
    "stiffness": " N m/rad",
    "damping": " N m s/rad",
    "length": " m",
    "outer": " m",
    "inner": " m",
    "diameter": " m",
    "bore": " m",
    "shear_modulus": " Pa",
    "tensile_strength": " Pa",
    "damping_hz": " Hz",
}
_ASKED = {
    "diameter": "diameter (or outer) in m",
    "stress_concentration": "stress_concentration (C_K of the form, 1 for an integral flange, less otherwise)",
    "tensile_strength": "tensile_strength in Pa",
}


def shaft_errors(shaft) -> list[str]:
    """Check that a shaft has one stiffness and one damping, and what its limits need."""
    return _stiffness_errors(shaft) + _damping_errors(shaft) + _section_errors(shaft)


def mesh_errors(mesh) -> list[str]:
    """Check what the law of a mesh is made of, and that it has one damping."""
    texts = _damping_errors(mesh, damping=" N s/m")
    both = [key for key in ("epsilon", "transition") if getattr(mesh, key) is not None]
    if mesh.law and both:
        texts.append(f"law = {shown(mesh.law)} is given together with {' and '.join(both)}. Keep one of them.")
    return texts


def damper_errors(damper) -> list[str]:
    """Check that a damper's ring is held by something, and that it has one damping."""
    if damper.stiffness != 0 or damper.damping != 0:
        return _damping_errors(damper)
    way = _given(damper, "magnifier", "damping_ratio")
    if way:
        needs = "needs a stiffness greater than 0 N m/rad, of which the damping is a share"
        return [f"{way[0]} {needs}. Give a stiffness, or the damping in N m s/rad."]
    if damper.order is None:
        return ["damping and stiffness are both 0, so that the ring is loose. Give at least one of them."]
    return _damping_errors(damper)


def _given(link, *keys, **units) -> list[str]:
    """``key = value unit`` of the keys that are given, not as 0."""
    found = [(key, getattr(link, key, None)) for key in keys]
    found = [(key, value) for key, value in found if value is not None and not (number_like(value) and value == 0)]
    units = _UNITS | units
    return [f"{key} = {value:g}{units.get(key, '')}" if plain_number(value) else f"{key}" for key, value in found]


def plain_number(value) -> bool:
    """Whether a value is a number that can be printed, no text, no truth value and not infinite."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300


def _and(words) -> str:
    words = list(words)
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def _stiffness_errors(shaft) -> list[str]:
    sizes = _given(shaft, "length", "outer", "inner", "shear_modulus")
    if shaft.stiffness is not None:
        if not sizes:
            return []
        own = (_given(shaft, "stiffness") or ["stiffness"])[0]
        rest = "Keep stiffness, or length, outer, inner and shear_modulus."
        return [f"{own} is given together with {_and(sizes)}. {rest}"]
    lacking = [key for key in ("length", "outer", "shear_modulus") if getattr(shaft, key) is None]
    if not sizes:
        text = "the key 'stiffness' is missing. Give greater than 0 N m/rad"
        return [f"{text}, or length, outer and inner in m and shear_modulus in Pa."]
    if lacking:
        return [f"{_and(sizes)} without {_and(lacking)} give no stiffness. Give the rest, or stiffness in N m/rad."]
    return _hole_errors(shaft, "inner", "outer")


def _hole_errors(shaft, hole: str, around: str) -> list[str]:
    inside, outside = getattr(shaft, hole), getattr(shaft, around)
    if not (number_like(inside) and number_like(outside)) or inside < outside:
        return []
    return [f"{hole} is {inside:g} m, must be less than {around} = {outside:g} m. Correct one of them."]


def _damping_errors(link, **units) -> list[str]:
    ways = _given(link, "damping", "magnifier", "damping_ratio", **units)
    shares, at = _given(link, "magnifier", "damping_ratio"), _given(link, "damping_hz")
    if shares:
        ways += _given(link, "loss_factor")
    if len(ways) > 1:
        return [f"{ways[0]} is given together with {_and(ways[1:])}. Keep one of them."]
    if shares and not at:
        return [f"{shares[0]} is given without damping_hz. Give the frequency in Hz at which it holds."]
    if at and not shares:
        return [f"{at[0]} is given without magnifier or damping_ratio. Give one of them, or leave it out."]
    return []


def _section_errors(shaft) -> list[str]:
    texts, bore = [], _given(shaft, "bore")
    if bore and shaft.diameter is None:
        texts.append(f"{bore[0]} is given without diameter. Give the outer diameter in m.")
    elif bore:
        texts += _hole_errors(shaft, "bore", "diameter")
    asked = _given(shaft, "stress_concentration", "tensile_strength")
    lacking = [key for key in _ASKED if getattr(shaft, key) is None and (key != "diameter" or shaft.outer is None)]
    if asked and lacking:
        limits = f"{_and(asked)} {'ask' if len(asked) > 1 else 'asks'} for the stress limits of IACS UR M68"
        texts.append(f"{limits}, without {_and(lacking)}. Give {_and(_ASKED[key] for key in lacking)}.")
    return texts


def rated_errors(parts, rated_rpm) -> list[str]:
    """Check the rated speed, and that it is there where limits depend on it."""
    if rated_rpm is not None:
        if number_like(rated_rpm) and 0.0 < float(rated_rpm) < float("inf"):
            return []
        unit = " rpm" if number_like(rated_rpm) else ""
        text = f"rated_rpm is {shown(rated_rpm)}{unit}, must be greater than 0 rpm. Correct it or leave the key out."
        return [f"{parts.source}, [scene]: {text}"]
    judged = [i for i, shaft in enumerate(parts.tables["shaft"]) if shaft.tensile_strength is not None]
    if not judged:
        return []
    names = _and(repr(parts.names["shaft"][i]) for i in judged[:8]) + (", …" if len(judged) > 8 else "")
    text = f"the key 'rated_rpm' is missing; the stress limits of {names} depend on the speed over it"
    return [f"{parts.source}, [scene]: {text}. Give the rated speed of the reference rotor in rpm."]
