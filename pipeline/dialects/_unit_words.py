"""Units of length and angle as files and their authors call them."""

from __future__ import annotations

UNIT_WORDS = {
    "mm": "mm", "millimeter": "mm", "millimeters": "mm", "millimetre": "mm", "millimetres": "mm",
    "m": "m", "meter": "m", "meters": "m", "metre": "m", "metres": "m",
    "in": "in", "inch": "in", "inches": "in",
    "um": "um", "µm": "um", "μm": "um", "micron": "um", "microns": "um",
    "ft": "ft", "foot": "ft", "feet": "ft", "cm": "cm", "centimeter": "cm", "centimeters": "cm",
    "centimetre": "cm", "centimetres": "cm",
    "ftus": "ftUS", "usft": "ftUS", "us ft": "ftUS", "ft us": "ftUS", "ft-us": "ftUS",
    **dict.fromkeys(
        ("millimetri", "millimetro", "millimètre", "millimètres", "milímetros", "milimetros",
         "milimetr", "milimetry", "milimetre", "миллиметры", "мм", "毫米", "밀리미터"), "mm"),
    **dict.fromkeys(("metri", "metro", "metros", "mètre", "mètres", "metry", "метры", "米"), "m"),
    "us-ft": "ftUS", "sft": "ftUS", "us survey foot": "ftUS", "us survey feet": "ftUS",
    "survey feet": "ftUS", "us feet": "ftUS",
}  # fmt: skip
ANGLE_WORDS = {
    "deg": "deg", "degree": "deg", "degrees": "deg", "°": "deg",
    "rad": "rad", "radian": "rad", "radians": "rad", "gon": "gon", "gons": "gon",
}  # fmt: skip
