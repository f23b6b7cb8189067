"""Which texts the modules of OpenMORA accept or silently ignore, by the source of each rule."""

from robots.api.geometry import Pose2D

# metres: the particle filter's own half widths, its X_MIN … Y_MAX, -1 and 1 unless its mission file
# says otherwise
X_MAX = Y_MAX = 1.0
GOAL_COLUMNS, AREA_COLUMNS = 2, 5


def matrix(text):
    """MRPT's CMatrix.fromMatlabStringFormat: rows of equal length in brackets, separated by
    semicolons; None if malformed.
    """
    text = text.strip()
    if not (text.startswith("[") and text.endswith("]")):
        return None
    try:
        rows = [
            [float(number) for number in row.replace(",", " ").split()]
            for row in text[1:-1].split(";")
        ]
    except ValueError:
        return None
    return rows if len({len(row) for row in rows}) == 1 else None


def target(text):
    """NAVIGATE_TARGET (NavigatorReactivePTG/CReacNavPTGApp.cpp, Iterate): one row of at least two
    columns, else None.
    """
    rows = matrix(text)
    return rows[0][:2] if rows and len(rows) == 1 and len(rows[0]) >= GOAL_COLUMNS else None


def relocalize(world, text):
    """RELOCALIZE_IN_AREA (Localization2D_PF/CPFLocalizationApp.cpp, ProcessParticleFilter): a row
    of at least five columns, else nothing.

    The particles are spread around the middle of the box as wide as the filter's own limits: a
    robot within them is localized, another one is believed to be in the middle.
    """
    rows = matrix(text)
    if world.deaf or not rows or len(rows[0]) < AREA_COLUMNS or rows[0][4] < 1:
        return
    x, y = (rows[0][0] + rows[0][1]) / 2.0, (rows[0][2] + rows[0][3]) / 2.0
    truth = world.truth
    is_near = abs(truth.x - x) <= X_MAX and abs(truth.y - y) <= Y_MAX
    world.localize_at(truth if is_near else Pose2D(x, y, truth.theta))
