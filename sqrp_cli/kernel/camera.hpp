// The limits of cameras and detectors that do not depend on the scene (docs/reference/numbers.md, "Covered").
#pragma once
#include "base.hpp"

// Why a camera does not cover a box: the first limit that fails, in the order in which they are checked.
enum Cause { NONE, BEHIND, TOO_NEAR, TOO_FAR, OUT_OF_IMAGE, DETECTOR_NEAR, DETECTOR_FAR, OBLIQUE, TOO_SMALL, HIDDEN, SAME_COLOUR, TOO_DARK, TOO_BRIGHT };

constexpr double PI = 3.14159265358979323846;
constexpr double STEEPEST = 80 * PI / 180;  // the largest angle at which markers are read [rad]
constexpr double LEAST_SIDE = 0.011;        // of a marker's outline that is looked at, as a share of the image's longer side

// A camera as `kernel.py` writes it.
struct Camera {
    double model;         // of the lens: 0 none, 1 equidistant, 2 polynomial (plumb_bob and rational_polynomial)
    double D[8], radius;  // its coefficients; up to where in the plane z = 1 it is monotonic
    double K[6];          // the upper rows of the intrinsic matrix [pixels]
    double width, height, near, far, gain;
    Pose X_FC;            // its optical frame in its frame
    double frame;         // by number

    bool shows(Point p) const { return p.x * p.x + p.y * p.y <= radius * radius; }

    // Where the lens moves a point of the plane z = 1; one that it does not show stays.
    Point bend(Point p) const {
        if (model == 0 || !shows(p)) return p;
        double s = p.x * p.x + p.y * p.y;
        if (model == 1) {
            double r = sqrt(s), a = atan(r), w = a * a, bent = a * (1 + w * (D[0] + w * (D[1] + w * (D[2] + w * D[3]))));
            return r > 1e-9 ? (bent / r) * p : p;
        }
        double f = (1 + s * (D[0] + s * (D[1] + s * D[4]))) / (1 + s * (D[5] + s * (D[6] + s * D[7])));
        return {p.x * f + 2 * D[2] * p.x * p.y + D[3] * (s + 2 * p.x * p.x), p.y * f + D[2] * (s + 2 * p.y * p.y) + 2 * D[3] * p.x * p.y, 0};
    }

    Point pixel(Point bent) const { return {K[0] * bent.x + K[1] * bent.y + K[2], K[3] * bent.x + K[4] * bent.y + K[5], 0}; }

    // Whether a direction is in the image.
    bool has(V3 direction) const {
        Point p = flat(direction);
        if (!shows(p)) return false;
        p = pixel(bend(p));
        return !(p.x < -0.5 || p.y < -0.5 || p.x > width - 0.5 || p.y > height - 0.5);
    }
};

// A box of a target, with the limits of its detector, as `kernel.py` writes it.
struct Box {
    V3 half;                                // half its sides
    V3 shrunk, middle;                      // of the box without its skin: half its sides, and its centre in the box's frame
    V3 normal;
    double has_normal;
    double nearest, farthest, incidence, pixels, visible;
    double allows_truncation;               // whether what the image's edge leaves counts as what an occluder leaves
    double reads;                           // of a marker by what images usually show: the factor of its least size; else 0
    double least_light, most_light, whole;  // between which intensities it is told at gain 1, and whether only all of it is
    double frame;
    Pose X_FB;
};

// What a camera makes of a box: `by`, the side of the image, the solid, or the light, -1 of none; `figure`: by how much a
// limit of camera or detector is missed; `visible`: the share of the box.
struct Verdict { int cause = NONE, by = -1; double figure = 0, visible = NAN; };

// The image of a box.
struct Image {
    Point pixel[8];
    double beyond[4];   // by how much it is outside on the left, right, top and bottom [pixels]
    bool shown = true;  // whether the lens shows all corners
    int side = 0;       // on which it is furthest outside
    double outside() const { return beyond[side]; }

    Image(const Camera& camera, const V3* corners_C) {
        Bounds all;
        for (int i = 0; i < 8; i++) {
            Point p = flat(corners_C[i]);
            if (camera.model != 0) shown &= camera.shows(p), p = camera.bend(p);
            all.add(pixel[i] = camera.pixel(p));
        }
        double found[4] = {-0.5 - all.low.x, all.high.x - (camera.width - 0.5), -0.5 - all.low.y, all.high.y - (camera.height - 0.5)};
        for (int i = 0; i < 4; i++) beyond[i] = found[i], side = found[i] > found[side] ? i : side;
    }

    // Square root of the area of the convex hull of the corners [pixels].
    double size() const {
        Point points[8], around[16];
        memcpy(points, pixel, sizeof points);
        int n = outline(points, 8, around);
        return sqrt(0.5 * double_area(around, n).z);
    }

    // The share of the image that the camera's edges leave.
    double share_within(const Camera& camera) const {
        Point points[8], rest[24];
        memcpy(points, pixel, sizeof points);
        int n = outline(points, 8, rest);
        double whole = double_area(rest, n).z, w = camera.width - 0.5, h = camera.height - 0.5;
        n = cut(rest, n, [&](Point p) { return -0.5 - p.x; }), n = cut(rest, n, [&](Point p) { return p.x - w; });
        n = cut(rest, n, [&](Point p) { return -0.5 - p.y; }), n = cut(rest, n, [&](Point p) { return p.y - h; });
        return whole > 0 ? double_area(rest, n).z / whole : 0;
    }
};

// The smallest image of a box that its detector reads [pixels]; of markers: `camera/detector.py`.
inline double least_size(const Camera& camera, const Box& box, double incidence) {
    if (box.reads == 0) return box.pixels;
    double shorter = most(cos(incidence), cos(STEEPEST)), read = box.reads * sqrt(0.5 * (1 + shorter * shorter)) / shorter;
    return most(read, LEAST_SIDE * most(camera.width, camera.height) * 2 / (1 + shorter)) * sqrt(shorter);
}

inline double incidence_of(const Box& box, const Pose& X_CB, double distance) {
    if (!box.has_normal) return 0;
    double cosine = -dot(X_CB.turn(box.normal), X_CB.origin()) / most(distance, 1e-12);
    return acos(clamp(cosine, -1, 1));
}

// The first limit that fails, and by how much [m, pixels or rad].
inline Verdict check(const Camera& camera, const Box& box, const Pose& X_CB) {
    V3 corners[8];
    Bounds all;
    for (int i = 0; i < 8; i++) all.add(corners[i] = X_CB(corner(i, box.half)));
    if (!(all.low.z > 0)) return {BEHIND, -1, -all.low.z};
    if (!(all.low.z >= camera.near)) return {TOO_NEAR, -1, camera.near - all.low.z};
    if (!(all.high.z <= camera.far)) return {TOO_FAR, -1, all.high.z - camera.far};
    Image image(camera, corners);
    bool inside = image.shown && image.outside() <= 0;
    if (image.shown && !inside && box.allows_truncation) inside = image.share_within(camera) >= box.visible;
    if (!inside) return {OUT_OF_IMAGE, image.side, most(image.outside(), 0.0)};
    double distance = norm(X_CB.origin());
    if (!(distance >= box.nearest)) return {DETECTOR_NEAR, -1, box.nearest - distance};
    if (!(distance <= box.farthest)) return {DETECTOR_FAR, -1, distance - box.farthest};
    double incidence = incidence_of(box, X_CB, distance);
    if (!(incidence <= box.incidence)) return {OBLIQUE, -1, incidence - box.incidence};
    double smallest = least_size(camera, box, incidence), size = image.size();
    if (!(size >= smallest)) return {TOO_SMALL, -1, smallest - size};
    return {};
}
