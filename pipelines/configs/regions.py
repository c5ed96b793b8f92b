"""Settings of the regions that are found without a network: from depth, and from colour."""

from dataclasses import dataclass, field

from pipelines.configs.declaration import BY_EYE, choice, fraction, setting


@dataclass(frozen=True)
class ColorConfig:
    """Pieces that stand out from the support plane by colour: thin things, things without depth."""

    is_used: bool = choice(True, "Find regions by colour beside those from depth.", "D. 131")
    min_contrast: float = setting(
        9.0, "Lab", "Least difference of a thing's colour from the table's.", BY_EYE
    )
    lightness_weight: float = setting(
        0.5, "weight", "Weight of lightness, which shadows change, against hue.", BY_EYE
    )
    deviations: float = setting(
        3.5, "factor", "The same difference, by the standard deviation of the table.", BY_EYE
    )
    window: float = fraction(
        0.25, "Side of the window of the table's mean colour, of the image.", BY_EYE
    )
    min_pixels: int = setting(150, "px", "Least number of pixels of a piece.", BY_EYE, low=1)
    max_slenderness: float = setting(
        45.0, "factor", "Length by width beyond which a piece is cables and what they join.", BY_EYE
    )
    min_thickness: float = setting(
        7.0, "px", "Least width of a thing where it is widest; a cable has less.", BY_EYE
    )
    min_confined: float = fraction(
        0.6, "Share of a region within a piece of colour that may complete it.", BY_EYE
    )
    max_low: float = setting(
        2.5,
        "factor",
        "Height by that of noise up to which a region continues where the table is measured.",
        BY_EYE,
    )
    min_convexity: float = fraction(
        0.9, "Share of its convex outline that joins the low regions of a piece.", BY_EYE
    )


@dataclass(frozen=True)
class RegionConfig:
    """Regions found without a network: things that stand on the support plane."""

    max_distance: float = setting(2.0, "m", "Largest distance from the camera.", BY_EYE)
    max_range: float = setting(
        1.2, "m", "Depth beyond the nearest surfaces behind which all is background.", BY_EYE
    )
    plane_tolerance: float = setting(
        0.010,
        "1/m",
        "Distance from the support plane, in inverse depth; metres at one metre.",
        "D. 30",
    )
    min_plane_share: float = fraction(
        0.08, "Share of the near pixels below which a plane supports nothing.", BY_EYE
    )
    min_support_area: float = setting(
        0.008, "m2", "Seen area below which a plane is a finger before the lens.", "D. 106"
    )
    beneath_weight: float = setting(
        2.0, "weight", "Weight of a near pixel beneath a plane against one on it.", BY_EYE
    )
    support_margin: float = setting(
        0.03, "m", "Distance that objects may stand out over the plane's border.", BY_EYE
    )
    min_height: float = setting(0.006, "m", "Least height above the plane.", BY_EYE)
    max_height: float = setting(
        0.5, "m", "Height above the plane beyond which a thing is an arm or a wall.", BY_EYE
    )
    min_pixels: int = setting(200, "px", "Least number of pixels of a region.", BY_EYE, low=1)
    max_extent: float = setting(0.45, "m", "Largest diagonal of an object.", BY_EYE)
    max_cut_extent: float = setting(
        0.2, "m", "Largest diagonal of what the border of the image cuts off.", BY_EYE
    )
    max_cut_height: float = setting(
        0.05, "m", "Height up to which such a thing, a book say, may be as large as any.", BY_EYE
    )
    min_over_support: float = fraction(
        0.25, "Share of a thing that lies over the support's visible extent.", "D. 132"
    )
    min_support_behind: float = fraction(
        0.02, "Share of the support behind a large steep surface; a wall has less.", "D. 132"
    )
    max_border: float = setting(
        3.0,
        "px2/px",
        "Squared pixels on the image's border, by pixel, of a strip along it.",
        BY_EYE,
    )
    max_floating: float = setting(
        0.05, "m", "Largest gap between the table and the lowest visible part.", "D. 110"
    )
    depth_step: float = fraction(
        0.012, "Step between neighbours that parts surfaces, of their depth.", "D. 30"
    )
    normal_radius: int = setting(4, "px", "Radius that normals are smoothed over.", BY_EYE, low=1)
    crease_fold: float = setting(
        0.6, "factor", "2 sin(fold / 2) beyond which a concave crease parts regions.", "D. 30"
    )
    crease_reach: float = setting(
        4.5, "factor", "Length of a crease's chord, by that of a level chord, at most.", BY_EYE
    )
    color: ColorConfig = field(default_factory=ColorConfig)
