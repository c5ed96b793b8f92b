"""Settings for finding regions without a network, from depth and from colour."""

from dataclasses import dataclass, field

from pipelines.configs.declaration import BY_EYE, choice, fraction, setting

LEAST_PIXELS = "Least number of pixels of a region; in images under 640 px, fewer by their area."


@dataclass(frozen=True)
class ColorConfig:
    """Regions by colour contrast to the support plane: thin objects, objects without depth."""

    is_used: bool = choice(True, "Find regions by colour in addition to depth.", "D. 131")
    min_contrast: float = setting(
        9.0, "Lab", "Least colour difference between object and table.", BY_EYE
    )
    lightness_weight: float = setting(
        0.5, "weight", "Weight of lightness, which shadows change, against hue.", BY_EYE
    )
    deviations: float = setting(
        3.5,
        "factor",
        "Least colour difference, in standard deviations of the table's colour.",
        BY_EYE,
    )
    window: float = fraction(
        0.25, "Side of the window for the table's mean colour, relative to the image.", BY_EYE
    )
    min_pixels: int = setting(150, "px", LEAST_PIXELS, "D. 149", low=1)
    max_slenderness: float = setting(
        45.0, "factor", "Length by width beyond which cables are removed from a piece.", BY_EYE
    )
    min_thickness: float = setting(
        7.0,
        "px",
        "Least width of an object at its widest place, in images of 640 px; cables are thinner.",
        BY_EYE,
    )
    min_confined: float = fraction(
        0.6, "Share of a region inside a colour piece from which the piece completes it.", BY_EYE
    )
    max_low: float = setting(
        2.5,
        "factor",
        "Height, in heights of noise, up to which a region may continue over measured table.",
        BY_EYE,
    )
    min_convexity: float = fraction(
        0.9, "Share of its convex hull that a piece must fill to join its low regions.", BY_EYE
    )


@dataclass(frozen=True)
class RegionConfig:
    """Regions found without a network: objects on the support plane."""

    max_distance: float = setting(2.0, "m", "Largest distance from the camera.", BY_EYE)
    max_range: float = setting(
        1.2, "m", "Depth behind the nearest surfaces beyond which all is background.", BY_EYE
    )
    plane_tolerance: float = setting(
        0.010,
        "1/m",
        "Tolerance around the support plane, in inverse depth; metres at one metre.",
        "D. 30",
    )
    min_plane_share: float = fraction(
        0.08, "Share of the near pixels below which a plane is no support plane.", BY_EYE
    )
    min_support_area: float = setting(
        0.008, "m2", "Seen area below which a plane is a finger in front of the lens.", "D. 106"
    )
    beneath_weight: float = setting(
        2.0, "weight", "Weight of a near pixel beneath a plane against one on it.", BY_EYE
    )
    support_margin: float = setting(
        0.03, "m", "Distance that objects may extend beyond the plane's border.", BY_EYE
    )
    min_height: float = setting(0.006, "m", "Least height above the plane.", BY_EYE)
    max_height: float = setting(
        0.5, "m", "Height above the plane beyond which a piece is an arm or a wall.", BY_EYE
    )
    min_pixels: int = setting(200, "px", LEAST_PIXELS, "D. 149", low=1)
    max_extent: float = setting(0.45, "m", "Largest diagonal of an object.", BY_EYE)
    max_cut_extent: float = setting(
        0.2, "m", "Largest diagonal of an object cut off by the image border.", BY_EYE
    )
    max_cut_height: float = setting(
        0.05, "m", "Height up to which a cut-off object, e.g. a book, may have any size.", BY_EYE
    )
    min_over_support: float = fraction(
        0.25, "Least share of an object over the visible support plane.", "D. 132"
    )
    min_support_behind: float = fraction(
        0.02, "Least share of the support behind a large steep surface; a wall has less.", "D. 132"
    )
    max_border: float = setting(
        3.0,
        "px2/px",
        "Squared border pixels by pixels, beyond which a piece is a strip along the border.",
        BY_EYE,
    )
    max_floating: float = setting(
        0.05, "m", "Largest gap between the table and the lowest visible part.", "D. 110"
    )
    depth_step: float = fraction(
        0.012, "Depth step that separates surfaces, relative to their depth.", "D. 30"
    )
    normal_radius: int = setting(4, "px", "Radius for smoothing normals.", BY_EYE, low=1)
    crease_fold: float = setting(
        0.6, "factor", "2 sin(fold / 2) beyond which a concave crease separates regions.", "D. 30"
    )
    crease_reach: float = setting(
        4.5, "factor", "Largest length of a crease's chord, relative to a level chord.", BY_EYE
    )
    color: ColorConfig = field(default_factory=ColorConfig)
