# SPDX-License-Identifier: BSD-3-Clause
"""Inner loops, for numba, of the planners that use the outline of the robot: Hybrid A* (Dolgov et al., 2010) for
car-like robots, and a search over positions and headings for robots that turn on the spot.

Lengths are in cells of the costmap, x along its columns and y along its rows. A turn is 1 for left, -1 for right and 0
for straight. A piece of a path has one turn and a length, which is negative when the piece is driven backward.
"""

from __future__ import annotations

import heapq
import math
from typing import Any, NamedTuple

import numpy

from flexbt_navigation.costmaps.kernels import Bools, Costs, Squares, Weights
from flexbt_sim.world.plane.loops import Loop

GridPose = tuple[float, float, float]
"""A pose in cells: x, y and yaw."""

HEADINGS = 72
"""Number of headings of the search states, as in Nav2's SmacPlannerHybrid."""

PIECE = math.tau / 36.0
"""Angle of a bend between two states, rad; a straight piece is as long."""

REVERSE_COST = 2.0
REVERSAL_COST = 1.0
BEND_COST = 1.05
CLOSE_COST = 2.0
"""Factors by which a path costs more when it is driven backward, bends, or touches the margin; and the cost of each
change of direction, in turning radii."""

TRIED_CURVES = 6
"""Number of curves to the goal that are checked from one state."""

EAGERNESS = 1.3
"""Weight of the remaining cost relative to the cost so far: states closer to the goal are expanded first."""

PATIENCE = 3.0
"""Total number of states examined for a cheaper path, as a multiple of those examined until the first one was found."""

NEAR = 3.0
"""Distance to the goal, in turning radii, within which the estimate uses all the curves to the goal. Beyond it, the
estimate is the path over free cells, plus the turn into it and the turn out of it to the heading of the goal. Their
directions are measured over this distance: ahead on the path, and back from the goal."""

TOUCH = math.sqrt(0.5)
"""An obstacle touches the outline if the centre of its cell is nearer than this, as in a costmap."""

SLACK = 0.25
"""Maximum error, in cells, between two positions that are checked."""


STRIDE = math.sqrt(2.0)
"""Length, in cells, of a straight step of a robot that turns on the spot: it ends in another cell."""

OUTLINE_EAGERNESS = 1.25
"""EAGERNESS of the search for a robot that turns on the spot."""

STAY, AHEAD, LEAVE, ARRIVE = 0, 9, 12, 12 + HEADINGS
"""Steps of that search: none; to the centre of each of the eight neighbours; ahead, and turns to the next heading on
either side; away with each heading; and to the goal."""


class Outline(NamedTuple):
    """The outline of a robot among obstacles, with the squared gaps of a costmap.

    ``corners``, shape (n, 2), are the corners of its polygon, none for a circle. ``discs``, shape (n, 3), are centres
    and radii of discs that cover the robot. A circle of radius ``reach`` around its centre covers it too.
    """

    obstacles: Bools
    squares: Squares
    corners: Weights
    discs: Weights
    reach: float


class Ways(NamedTuple):
    """The shortest paths to one place over free neighbouring blocks: squares of ``block`` cells.

    For each block, by its number: its distance, infinite without a path; the next block; and the first block of the
    path that is near the place.
    """

    ahead: Weights
    following: Squares
    gates: Squares
    block: int


@Loop
def ways_to(free: Bools, row: int, column: int, near: float, block: int) -> Any:
    """Return the paths to the block at a row and column; blocks within ``near`` blocks of it are near."""
    height, width = free.shape
    found = numpy.full((height, width), math.inf)
    found[row, column] = 0.0
    following = numpy.arange(free.size).astype(numpy.int32)
    gates = following.copy()
    queue = [(0.0, row * width + column)]
    while queue:
        here, cell = heapq.heappop(queue)
        r, c = cell // width, cell % width
        if here > found[r, c]:
            continue
        if here > near:
            gates[cell] = gates[following[cell]]
        for up in range(-1, 2):
            for right in range(-1, 2):
                a, b = r + up, c + right
                if 0 <= a < height and 0 <= b < width and free[a, b]:
                    there = here + math.sqrt(up * up + right * right)
                    if there < found[a, b]:
                        found[a, b] = there
                        following[a * width + b] = cell
                        heapq.heappush(queue, (there, a * width + b))
    return Ways(found.reshape(free.size), following, gates, block)


@Loop
def far_from(squares: Squares, x: float, y: float) -> Any:
    """Return a lower bound of the distance to the nearest obstacle."""
    row = min(max(math.floor(y), 0), squares.shape[0] - 1)
    column = min(max(math.floor(x), 0), squares.shape[1] - 1)
    return math.sqrt(squares[row, column]) / 2.0 - math.hypot(y - row - 0.5, x - column - 0.5)


@Loop
def touches(obstacles: Bools, x: float, y: float, needed: float, to_centre: bool) -> Any:
    """Return whether an obstacle is nearer than ``needed``: the centre of its cell (``to_centre``), or its square."""
    height, width = obstacles.shape
    reach = needed if to_centre else needed + 0.5
    for row in range(max(0, math.ceil(y - reach - 0.5)), min(height, math.floor(y + reach + 0.5))):
        for column in range(max(0, math.ceil(x - reach - 0.5)), min(width, math.floor(x + reach + 0.5))):
            if obstacles[row, column]:
                up, right = abs(row + 0.5 - y), abs(column + 0.5 - x)
                if not to_centre:
                    up, right = max(up - 0.5, 0.0), max(right - 0.5, 0.0)
                if up * up + right * right < needed * needed:
                    return True
    return False


@Loop
def room(outline: Outline, slack: float, x: float, y: float, yaw: float) -> Any:
    """Return a lower bound of the distance that the outline of the robot can move before it touches an obstacle. It is
    negative if the outline touches one.

    An obstacle that is wholly inside the polygon is not detected where a disc touches something: a robot that gets
    there has touched the obstacle before.
    """
    obstacles, squares, corners, discs, reach = outline
    height, width = obstacles.shape
    if not (0.0 <= y < height and 0.0 <= x < width):
        return -1.0
    # The centre of a cell is at least half a cell from the edge of its square.
    touching = TOUCH - 0.5 if len(corners) else 0.0
    cos, sin = math.cos(yaw), math.sin(yaw)
    known = math.inf
    for i in range(len(discs)):
        dx, dy = discs[i, 0], discs[i, 1]
        known = min(known, far_from(squares, x + dx * cos - dy * sin, y + dx * sin + dy * cos) - discs[i, 2] - touching)
        if known < slack:
            break
    else:
        return known
    if len(corners) == 0:
        return -1.0 if touches(obstacles, x, y, reach + slack, False) else max(known, 0.0)
    # Positions on the outline are checked every quarter of a cell.
    needed = math.hypot(TOUCH + slack, 0.125)
    least, before, step = math.inf, math.inf, 0.0
    for i in range(len(corners)):
        ax, ay = corners[i - 1, 0], corners[i - 1, 1]
        dx, dy = corners[i, 0] - ax, corners[i, 1] - ay
        length = math.hypot(dx, dy)
        at = 0.0
        while True:
            px, py = ax + dx * at / length, ay + dy * at / length
            px, py = x + px * cos - py * sin, y + px * sin + py * cos
            gap = far_from(squares, px, py)
            if gap < needed - 0.5 and touches(obstacles, px, py, needed, True):
                return -1.0
            least = min(least, (before + gap - step) / 2.0)
            if at == length:
                break
            before, step = gap, min(length - at, max(0.25, gap - 0.5))
            at = length if step == length - at else at + step
    return max(least - touching, 0.0)


@Loop
def room_along(outline: Outline, pose: GridPose, right: float, up: float, turn: float) -> Any:
    """Return the least :func:`room` while the robot drives straight or turns by this much, without the start."""
    x, y, yaw = pose
    way = math.hypot(right, up) + abs(turn) * outline.reach
    if way == 0.0:
        return math.inf
    last = room(outline, 0.0, x + right, y + up, yaw + turn)
    least, gap, at = last, 0.0, 0.0
    while least >= 0.0:
        at += max(0.5, gap)
        if at + last >= way:  # the rest was checked from both of its ends
            break
        share = at / way
        gap = room(outline, 0.0, x + share * right, y + share * up, yaw + share * turn)
        least = min(least, gap)
    return least


@Loop
def stepped(pose: GridPose, step: int) -> Any:
    """Return the pose after a step, except the last one, of a robot that turns on the spot."""
    x, y, yaw = pose
    if step in (STAY, ARRIVE):
        return x, y, yaw
    if step < AHEAD:
        number = step - 1 if step <= 4 else step  # of nine cells, from the lower left one
        return math.floor(x) + number % 3 - 0.5, math.floor(y) + number // 3 - 0.5, yaw
    if step > AHEAD:
        before = math.floor(yaw / math.tau * HEADINGS + 0.5) if step < LEAVE else 0
        change = (1 if step == LEAVE - 1 else -1) if step < LEAVE else step - LEAVE
        yaw = (before + change) * math.tau / HEADINGS
        if step < LEAVE:
            return x, y, yaw
    return x + STRIDE * math.cos(yaw), y + STRIDE * math.sin(yaw), yaw


@Loop
def room_on_way(outline: Outline, way: Weights, yaw: float, end: float) -> Any:
    """Return the least :func:`room` of a robot that turns on the spot, on straight lines between points, shape (n, 2).
    It arrives with heading ``yaw`` and leaves with ``end``."""
    least = math.inf
    for i in range(len(way)):
        x, y = way[i, 0], way[i, 1]
        right, up = (way[i + 1, 0] - x, way[i + 1, 1] - y) if i + 1 < len(way) else (0.0, 0.0)
        course = math.atan2(up, right) if right * right + up * up > 1e-12 else yaw if i + 1 < len(way) else end
        turn = (course - yaw + math.pi) % math.tau - math.pi
        least = min(least, room_along(outline, (x, y, yaw), 0.0, 0.0, turn))
        least = min(least, room_along(outline, (x, y, course), right, up, 0.0))
        if least < 0.0:
            break
        yaw = course
    return least


@Loop
def moved(x: float, y: float, yaw: float, turn: float, length: float, turning_radius: float) -> Any:
    """Return the pose after a piece of a path."""
    if turn == 0.0:
        return x + length * math.cos(yaw), y + length * math.sin(yaw), yaw
    after = yaw + turn * length / turning_radius
    radius = turning_radius * turn
    return x + radius * (math.sin(after) - math.sin(yaw)), y - radius * (math.cos(after) - math.cos(yaw)), after


@Loop
def cost_of_piece(
    outline: Outline,
    slack: float,
    margin: float,
    pose: GridPose,
    gap: float,
    turn: float,
    length: float,
    turning_radius: float,
) -> Any:
    """Return the cost of driving a piece, infinite if the robot touches something after its start, and the room at its
    end. ``gap`` is the room at its start."""
    x, y, yaw = moved(pose[0], pose[1], pose[2], turn, length, turning_radius)
    last = room(outline, slack, x, y, yaw)
    if last < 0.0:
        return math.inf, last
    swing = 1.0 + abs(turn) * outline.reach / turning_radius
    whole = abs(length)
    at, close = 0.0, 0.0
    while at < whole:
        step, there = max(0.5, gap) / swing, last
        if at + step + last / swing >= whole:  # the rest was checked from both of its ends
            step = whole - at
        else:
            x, y, yaw = moved(pose[0], pose[1], pose[2], turn, math.copysign(at + step, length), turning_radius)
            there = room(outline, slack, x, y, yaw)
            if there < 0.0:
                return math.inf, last
        close += step * (max(0.0, 1.0 - max(0.0, gap) / margin) + max(0.0, 1.0 - there / margin)) / 2.0
        at, gap = at + step, there
    cost = whole + (CLOSE_COST - 1.0) * close
    if turn != 0.0:
        cost *= BEND_COST
    return cost * REVERSE_COST if length < 0.0 else cost, last


@Loop
def curves(x: float, y: float, yaw: float, reverses: bool) -> Weights:
    """Return the paths of three pieces from the origin, heading along x, to a pose: turns, lengths and cost, shape (n,
    7).

    Lengths are in turning radii. The paths are the words CSC and CCC of Reeds and Shepp (1990), in all directions;
    without ``reverses``, those of Dubins (1957).
    """
    found = numpy.empty((64, 7))
    count = 0
    for turn in (1.0, -1.0):
        # A path that begins with a right bend mirrors one that begins with a left bend.
        my, myaw = turn * y, turn * yaw
        for kind in range(4):
            to_left = kind != 1
            dx = x - math.sin(myaw) if to_left else x + math.sin(myaw)
            dy = my - 1.0 + math.cos(myaw) if to_left else my - 1.0 - math.cos(myaw)
            apart, bearing = math.hypot(dx, dy), math.atan2(dy, dx)
            for backward in range(2):
                if kind == 0:
                    middle = -apart if backward else apart
                    first = bearing + math.pi if backward else bearing
                    last = myaw - first
                elif kind == 1:
                    if apart < 2.0:
                        continue
                    middle = math.sqrt(apart * apart - 4.0)
                    aside = math.atan2(2.0, middle)
                    first = bearing - aside + math.pi if backward else bearing + aside
                    middle = -middle if backward else middle
                    last = first - myaw
                else:
                    if apart > 4.0:
                        continue
                    half = math.asin(apart / 4.0)
                    middle = 2.0 * half if kind == 2 else math.tau - 2.0 * half
                    first = bearing + middle / 2.0
                    middle -= math.tau * backward
                    last = myaw - first + middle
                if backward and not reverses:
                    continue
                first, last = first % math.tau, last % math.tau
                for negative in range(4 if reverses else 1):
                    one = first - math.tau * (negative % 2)
                    other = last - math.tau * (negative // 2)
                    if reverses and max(abs(one), abs(other)) > 1.5 * math.pi:
                        continue
                    found[count, 0], found[count, 3] = turn, one
                    found[count, 1], found[count, 4] = 0.0 if kind < 2 else -turn, middle
                    found[count, 2], found[count, 5] = turn if to_left else -turn, other
                    cost, before = 0.0, 0.0
                    for i in range(3):
                        length = found[count, 3 + i]
                        if length != 0.0:
                            piece = abs(length) if found[count, i] == 0.0 else abs(length) * BEND_COST
                            cost += piece * REVERSE_COST if length < 0.0 else piece
                            cost += REVERSAL_COST if before * length < 0.0 else 0.0
                            before = length
                    found[count, 6] = cost
                    count += 1
    return found[:count]


@Loop
def turn_into(angle: float) -> Any:
    """Return the extra cost, in turning radii, of a bend into a straight path: its length minus its progress along the
    path."""
    angle = abs((angle + math.pi) % math.tau - math.pi)
    return BEND_COST * angle - math.sin(angle)


@Loop
def hybrid_search(
    outline: Outline,
    slack: float,
    margin: float,
    ways: Ways,
    start: GridPose,
    goal: GridPose,
    turning_radius: float,
    piece: float,
    reverses: bool,
    most: int,
    stop: Costs,
) -> Any:
    """Return the pieces of a path from one pose to another, turns and lengths of shape (n, 2), and the number of states
    examined.

    No bend is tighter than ``turning_radius``. The path costs more where it is nearer than ``margin`` to obstacles.
    ``ways`` are the paths to the goal, with the gates of NEAR. The result is empty if there is no path, if ``most``
    states were examined, or if another thread sets ``stop[0]``.
    """
    ahead, following, gates, block = ways
    height, width = outline.obstacles.shape
    across = (width + block - 1) // block
    look = math.ceil(NEAR * turning_radius / block)
    cell = piece / math.sqrt(2.0)
    columns = int(width / cell) + 1
    size = 1
    while size < 2 * most:
        size *= 2
    slots = numpy.full(size, -1, numpy.int32)
    keys = numpy.empty(most, numpy.int64)
    poses = numpy.empty((most, 3))
    spent = numpy.empty(most)
    parents = numpy.empty(most, numpy.int32)
    turns = numpy.zeros(most, numpy.int8)
    directions = numpy.zeros(most, numpy.int8)
    is_done = numpy.zeros(most, numpy.uint8)
    poses[0, 0], poses[0, 1], poses[0, 2] = start
    spent[0], parents[0], keys[0] = 0.0, -1, -1
    count, looked = 1, 0
    best, best_node, last = math.inf, -1, most
    best_curve = numpy.zeros(7)
    queue = [(0.0, 0)]
    while queue and count < most:
        total, node = heapq.heappop(queue)
        if total >= best or looked > last:
            break
        if is_done[node]:
            continue
        is_done[node] = 1
        looked += 1
        if looked % 64 == 0 and stop[0]:
            return numpy.empty((0, 2)), count
        pose = (poses[node, 0], poses[node, 1], poses[node, 2])
        gap = room(outline, slack, pose[0], pose[1], pose[2])
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        right, up = (goal[0] - pose[0]) / turning_radius, (goal[1] - pose[1]) / turning_radius
        left = (total - spent[node]) / piece / EAGERNESS
        if looked % (1 + int(left / 8.0)) == 0:
            options = curves(right * cos + up * sin, up * cos - right * sin, goal[2] - pose[2], reverses)
            for _ in range(min(TRIED_CURVES, len(options))):
                option = int(numpy.argmin(options[:, 6]))
                chosen = options[option].copy()
                options[option, 6] = math.inf
                if spent[node] + chosen[6] * turning_radius >= best:
                    break
                here, there, cost = pose, gap, spent[node]
                before = float(directions[node])
                for i in range(3):
                    length = chosen[3 + i] * turning_radius
                    if length == 0.0:
                        continue
                    if before * length < 0.0:
                        cost += REVERSAL_COST * turning_radius
                    before = length
                    added, there = cost_of_piece(outline, slack, margin, here, there, chosen[i], length, turning_radius)
                    cost += added
                    if cost >= best:
                        break
                    here = moved(here[0], here[1], here[2], chosen[i], length, turning_radius)
                if cost < best:
                    if best_node < 0:
                        last = int(PATIENCE * looked) + HEADINGS
                    best, best_node, best_curve = cost, node, chosen
        for way in range(6 if reverses else 3):
            turn, length = float(way % 3 - 1), piece if way < 3 else -piece
            x, y, yaw = moved(pose[0], pose[1], pose[2], turn, length, turning_radius)
            if not (0.0 <= y < height and 0.0 <= x < width):
                continue
            square = int(y) // block * across + int(x) // block
            remains = ahead[square]
            if remains == math.inf:
                continue
            yaw %= math.tau
            heading = int(yaw / math.tau * HEADINGS + 0.5) % HEADINGS
            key = (int(y / cell) * columns + int(x / cell)) * HEADINGS + heading
            slot = (key * 2654435761) % size
            while slots[slot] >= 0 and keys[slots[slot]] != key:
                slot = (slot + 1) % size
            other = slots[slot]
            if other >= 0 and is_done[other]:
                continue
            added, _ = cost_of_piece(outline, slack, margin, pose, gap, turn, length, turning_radius)
            cost = spent[node] + added
            if directions[node] * length < 0.0:
                cost += REVERSAL_COST * turning_radius
            if cost == math.inf or (other >= 0 and cost >= spent[other]):
                continue
            # Distances over squares are too long by up to a twelfth, plus the part within the first and last square.
            least = max(0.0, 0.92 * (remains - 1.5) * block)
            if least < NEAR * turning_radius:
                cos, sin = math.cos(yaw), math.sin(yaw)
                right, up = (goal[0] - x) / turning_radius, (goal[1] - y) / turning_radius
                options = curves(right * cos + up * sin, up * cos - right * sin, goal[2] - yaw, reverses)
                least = max(least, turning_radius * options[:, 6].min())
            else:
                farther, gate = square, gates[square]
                for _ in range(look):
                    farther = following[farther]
                course = math.atan2(farther // across - square // across, farther % across - square % across)
                arrival = math.atan2(goal[1] - gate // across * block, goal[0] - gate % across * block)
                least += turning_radius * (turn_into(course - yaw) + turn_into(goal[2] - arrival))
            if other < 0:
                if count == most:
                    break
                other = count
                slots[slot], keys[other] = other, key
                count += 1
            poses[other, 0], poses[other, 1], poses[other, 2] = x, y, yaw
            spent[other], parents[other] = cost, node
            turns[other], directions[other] = way % 3 - 1, 1 if way < 3 else -1
            heapq.heappush(queue, (cost + EAGERNESS * least, other))
    if best_node < 0:
        return numpy.empty((0, 2)), count
    steps = 0
    node = best_node
    while parents[node] >= 0:
        steps += 1
        node = parents[node]
    pieces = numpy.empty((steps + 3, 2))
    node = best_node
    for i in range(steps - 1, -1, -1):
        pieces[i, 0], pieces[i, 1] = turns[node], directions[node] * piece
        node = parents[node]
    for i in range(3):
        pieces[steps + i, 0], pieces[steps + i, 1] = best_curve[i], best_curve[3 + i] * turning_radius
    return pieces, count


@Loop
def outline_search(
    outline: Outline,
    margin: float,
    costs: Costs,
    weights: Weights,
    is_roomy: Bools,
    ahead: Weights,
    start: GridPose,
    goal: GridPose,
    most: int,
    stop: Costs,
) -> Any:
    """Return the points, shape (n, 2), of a path from one pose to another for a robot that turns on the spot, and the
    number of states examined. Its outline has room all along the path and wherever it turns.

    A cell that ``is_roomy`` is one state: the robot can turn anywhere in it. Other cells have a state for each of
    ``HEADINGS``. A step costs its length times the mean of the ``weights`` of the costs of its cells. A turn in a cell
    that is not roomy costs half of the distance that the farthest corner moves. Both cost more where there is less room
    than ``margin``. ``ahead`` is the minimum cost of the path to the goal, by cell. A step is checked when it leaves
    the queue, not when it enters it, since most never leave it. The result is empty if there is no path, if ``most``
    states were examined, or if another thread sets ``stop[0]``.
    """
    height, width = costs.shape
    reach = outline.reach
    poses = numpy.empty((most, 3))
    spent = numpy.empty(most)
    parents = numpy.empty(most, numpy.int32)
    done = {-1}
    # Lower bound of the total cost, cost so far, previous state, step from it, and whether it has room.
    queue = [(0.0, 0.0, -1, STAY, True)]
    count, looked, last = 0, 0, -1
    way = numpy.empty((2, 2))
    way[1, 0], way[1, 1] = goal[0], goal[1]
    while queue and count < most:
        total, cost, before, step, has_room = heapq.heappop(queue)
        looked += 1
        if looked % 64 == 0 and stop[0]:
            break
        pose = start if before < 0 else (poses[before, 0], poses[before, 1], poses[before, 2])
        x, y, yaw = stepped(pose, step)
        row, column = math.floor(y), math.floor(x)
        roomy = is_roomy[row, column]
        heading = 0 if roomy else math.floor(yaw / math.tau * HEADINGS + 0.5) % HEADINGS
        key = (row * width + column) * HEADINGS + heading
        if step != ARRIVE and key in done:
            continue
        if not has_room:
            if step == ARRIVE:
                way[0, 0], way[0, 1] = x, y
                course = math.atan2(goal[1] - y, goal[0] - x) if roomy else yaw
                gap = room_on_way(outline, way, course, goal[2])
            else:
                begin = yaw if step >= LEAVE else pose[2]
                right, up, turn = x - pose[0], y - pose[1], yaw - begin
                begins = (pose[0], pose[1], begin)
                gap = room_along(outline, begins, right, up, turn)
            if gap < 0.0:
                continue
            if gap < margin:
                added = (cost - spent[before]) * (CLOSE_COST - 1.0) * (1.0 - gap / margin)
                heapq.heappush(queue, (total + added, cost + added, before, step, True))
                continue
        if step == ARRIVE:
            last = before
            break
        done.add(key)
        node = count
        count += 1
        poses[node, 0], poses[node, 1], poses[node, 2] = x, y, yaw
        spent[node], parents[node] = cost, before
        weight = weights[costs[row, column]]
        apart = math.hypot(goal[0] - x, goal[1] - y)
        if apart <= NEAR * reach:
            there = cost + (apart + reach / HEADINGS) * weight
            heapq.heappush(queue, (there, there, node, ARRIVE, False))
        for step in range(STAY + 1, ARRIVE):
            if roomy == (AHEAD <= step < LEAVE):
                continue
            x, y, yaw = stepped((poses[node, 0], poses[node, 1], poses[node, 2]), step)
            r, c = math.floor(y), math.floor(x)
            if not (0 <= r < height and 0 <= c < width) or ahead[r, c] == math.inf:
                continue
            if roomy and is_roomy[r, c] == (step >= LEAVE):
                continue
            heading = 0 if is_roomy[r, c] else math.floor(yaw / math.tau * HEADINGS + 0.5) % HEADINGS
            if (r * width + c) * HEADINGS + heading in done:
                continue
            if AHEAD < step < LEAVE:
                length = reach * math.tau / HEADINGS / 2.0
            else:
                length = math.hypot(x - poses[node, 0], y - poses[node, 1])
            there = cost + length * (weight + weights[costs[r, c]]) / 2.0
            heapq.heappush(queue, (there + OUTLINE_EAGERNESS * ahead[r, c], there, node, step, step < AHEAD))
    length, node = 0, last
    while node >= 0:
        length += 1
        node = parents[node]
    points = numpy.empty((length + (last >= 0), 2))
    node = last
    for i in range(length - 1, -1, -1):
        points[i, 0], points[i, 1] = poses[node, 0], poses[node, 1]
        node = parents[node]
    if last >= 0:
        points[length, 0], points[length, 1] = goal[0], goal[1]
    return points, count
