// Distances of convex pieces, by their exact forms.
#pragma once
#include "surface.hpp"

constexpr double EXACT = 1e-10;    // distances are sure to this [m]
constexpr int MOST_STEPS = 100;    // towards the distance of two pieces

// Points within `margin` of a core: a triangle, a box, the axis of a capsule, the centre of a sphere, or a cylinder.
struct Piece {
    Form form;
    Triangle t;
    Pose X;
    V3 half;
    double margin = 0;
    const V3* points = nullptr;  // of the hull of so many points instead
    int count = 0;

    static Piece of(const Triangle& t) { return {Form::mesh, t, Pose(), {0, 0, 0}, 0}; }
    static Piece of(const V3* points, int count) { return {Form::mesh, {}, Pose(), {0, 0, 0}, 0, points, count}; }
    static Piece of(const Solid& s, const Pose& X) { return {s.form, {}, X, s.half, s.form == Form::sphere || s.form == Form::capsule ? s.half.x : 0}; }

    V3 support(V3 d) const {  // the point of the core that is furthest in a direction
        if (points) {
            V3 best = points[0];
            for (int i = 1; i < count; i++) best = dot(points[i], d) > dot(best, d) ? points[i] : best;
            return best;
        }
        if (form == Form::mesh) {
            double a = dot(t.a, d), b = dot(t.b, d), c = dot(t.c, d);
            return a >= b && a >= c ? t.a : b >= c ? t.b : t.c;
        }
        if (form == Form::sphere) return X.origin();
        V3 l = X.turn_back(d);
        double z = l.z < 0 ? -half.z : half.z, across = sqrt(l.x * l.x + l.y * l.y), r = across > 0 ? half.x / across : 0;
        if (form == Form::box) return X({l.x < 0 ? -half.x : half.x, l.y < 0 ? -half.y : half.y, z});
        return form == Form::capsule ? X({0, 0, z}) : X({r * l.x, r * l.y, z});
    }
};

// The hull of at most four points. Each `nearest` keeps the points that carry what of it is nearest to the origin.
struct Simplex {
    V3 p[4];
    int n = 0;

    V3 nearest() {
        if (n == 1) return p[0];
        if (n == 2) {
            V3 side = p[1] - p[0];
            double share = -dot(p[0], side), whole = dot(side, side);
            if (share >= whole) p[0] = p[1];
            if (share <= 0 || share >= whole) return n = 1, p[0];
            return p[0] + (share / whole) * side;
        }
        Simplex best;
        V3 found{ENDLESS, ENDLESS, ENDLESS}, normal = cross(p[1] - p[0], p[2] - p[0]);
        double size = dot(normal, normal);
        bool inside = n == 4 || size > 1e-40;
        for (int i = 0; i < n; i++) {  // the sides or faces that the origin lies beyond
            Simplex part;
            for (int k = 0; k < n; k++)
                if (k != i) part.p[part.n++] = p[k];
            V3 out = cross(part.p[1] - part.p[0], n == 4 ? part.p[2] - part.p[0] : normal);
            double other = dot(out, p[i] - part.p[0]), origin = -dot(out, part.p[0]);
            if (other * origin > 0) continue;
            V3 at = part.nearest();
            if (dot(at, at) < dot(found, found)) found = at, best = part;
            inside = false;
        }
        if (inside) return n == 4 ? V3{0, 0, 0} : (dot(p[0], normal) / size) * normal;
        if (best.n) *this = best;
        return found;
    }
};

// The distance of two pieces, 0 where they meet, ENDLESS if it is more than `limit`; one of at most `enough` may be
// too large (Gilbert, Johnson and Keerthi 1988).
inline double distance(const Piece& A, const Piece& B, double limit, double enough) {
    double margin = A.margin + B.margin, lower = 0, size = ENDLESS;
    V3 v{1, 0, 0};
    Simplex S;
    for (int step = 0; step < MOST_STEPS; step++) {
        V3 w = A.support(-1.0 * v) - B.support(v);
        lower = most(lower, dot(v, w) / norm(v));
        if (lower - margin > limit + EXACT) return ENDLESS;
        if (size - lower <= EXACT) break;
        S.p[S.n++] = w;
        V3 next = S.nearest();
        double length = norm(next);
        if (length >= size) break;  // by rounding
        v = next, size = length;
        if (size - margin <= most(enough, 0.0) || size < EXACT) break;
        if (step == MOST_STEPS - 1) size = lower;
    }
    return size - margin > limit + EXACT ? ENDLESS : most(size - margin, 0.0);
}
