// The view hull of a box: the convex hull of an eye and the box's corners. What reaches into it hides some of the box
// (docs/reference/numbers.md, "Visible").
#pragma once
#include "convex.hpp"

constexpr int PLANES = 12;           // of a hull: at most 5 faces of the box, and at most 6 beside it; padded
constexpr int CORNERS = 24;          // room for a triangle cut by all of them, which has 3 + 12 corners
constexpr double TOUCH = 1e-9;       // bounds that are nearer than this count as touching [m]

struct Polygon { V3 p[CORNERS]; int n; Polygon() : n(0) {} };

// A hull as half spaces: points p with n . p <= offset are inside.
struct Hull {
    double x[PLANES], y[PLANES], z[PLANES], offset[PLANES];
    int count = 0;
    uint32_t far = 0;                // which planes are faces of the box that are turned away from the eye: its far side
    V3 point[9];                     // the box's corners, x slowest, and the eye
    Bounds bounds;

    V3 eye() const { return point[8]; }
    uint32_t all() const { return (1u << count) - 1; }

    // half, middle: of the box, in its own frame B; eye: in the world.
    static Hull of(const Pose& X_WB, V3 half, V3 middle, V3 eye_W) {
        Hull H;
        V3 e = X_WB.back(eye_W) - middle, normal[PLANES];
        double eye[3] = {e.x, e.y, e.z}, h[3] = {half.x, half.y, half.z}, reach[PLANES];
        bool turned[3][2];  // each face: whether to the eye
        for (int a = 0; a < 3; a++) turned[a][0] = -eye[a] > h[a], turned[a][1] = eye[a] > h[a];
        for (int a = 0; a < 3; a++)
            for (int s = 0; s < 2; s++)
                if (!turned[a][s]) {
                    double n[3] = {0, 0, 0};
                    n[a] = s ? 1 : -1, H.far |= 1u << H.count;
                    normal[H.count] = {n[0], n[1], n[2]}, reach[H.count++] = h[a];
                }
        // Beside it, planes run through the eye and the edges between faces that are turned to it and away from it.
        for (int a = 0; a < 3; a++)
            for (int b = a + 1; b < 3; b++)
                for (int s = 0; s < 2; s++)
                    for (int t = 0; t < 2; t++) {
                        if (turned[a][s] == turned[b][t] || H.count == PLANES) continue;
                        double p[3] = {0, 0, 0}, d[3] = {0, 0, 0};
                        p[a] = s ? h[a] : -h[a], p[b] = t ? h[b] : -h[b], d[3 - a - b] = 1;
                        V3 m = cross(V3{p[0], p[1], p[2]} - e, V3{d[0], d[1], d[2]});
                        double size = norm(m);
                        if (size < 1e-15) continue;
                        normal[H.count] = (dot(m, e) < 0 ? -1 / size : 1 / size) * m;  // the box's centre, 0, is inside
                        reach[H.count] = dot(normal[H.count], e), H.count++;
                    }
        V3 center = X_WB(middle);
        for (int i = 0; i < PLANES; i++) {
            bool used = i < H.count;
            V3 n = used ? X_WB.turn(normal[i]) : V3{0, 0, 0};
            H.x[i] = n.x, H.y[i] = n.y, H.z[i] = n.z, H.offset[i] = used ? reach[i] + dot(n, center) : 1;
        }
        for (int i = 0; i < 9; i++) H.bounds.add(H.point[i] = i < 8 ? X_WB(corner(i, half) + middle) : eye_W);
        return H;
    }

    // The same in the frame P of a solid's parent.
    Hull in(const Pose& X_WP) const {
        Hull L;
        V3 t = X_WP.origin();
        const double* m = X_WP.m;
        for (int i = 0; i < PLANES; i++) {
            L.x[i] = m[0] * x[i] + m[4] * y[i] + m[8] * z[i], L.y[i] = m[1] * x[i] + m[5] * y[i] + m[9] * z[i];
            L.z[i] = m[2] * x[i] + m[6] * y[i] + m[10] * z[i], L.offset[i] = offset[i] - (x[i] * t.x + y[i] * t.y + z[i] * t.z);
        }
        L.count = count, L.far = far;
        for (int i = 0; i < 9; i++) L.bounds.add(L.point[i] = X_WP.back(point[i]));
        return L;
    }

    double height(int i, V3 p) const { return x[i] * p.x + y[i] * p.y + z[i] * p.z - offset[i]; }

    // Which planes a point is outside of, by more than a distance.
    uint32_t outside(V3 p, double by = 0) const {
        uint32_t out = 0;
        for (int i = 0; i < PLANES; i++) out |= uint32_t(height(i, p) > by) << i;
        return out;
    }

    // Whether a node may reach in. `planes` loses those of which all of the node is inside.
    bool may_meet(const Node& n, uint32_t& planes) const {
        V3 below = n.center - n.extent - bounds.high, above = bounds.low - n.center - n.extent;
        if (most(most(below.x, below.y), below.z) > 0 || most(most(above.x, above.y), above.z) > 0) return false;
        for (uint32_t left = planes; left; left &= left - 1) {
            int i = __builtin_ctz(left);
            double d = height(i, n.center), r = fabs(x[i]) * n.extent.x + fabs(y[i]) * n.extent.y + fabs(z[i]) * n.extent.z;
            if (d - r > 0) return false;
            if (d + r <= 0) planes &= ~(1u << i);
        }
        return true;
    }

    // The part of a triangle that is inside some of the planes, or all.
    Polygon clip(const Triangle& t, uint32_t planes) const {
        Polygon rest;
        rest.p[0] = t.a, rest.p[1] = t.b, rest.p[2] = t.c, rest.n = 3;
        for (int i = 0; i < count && rest.n; i++)
            if (planes >> i & 1) rest.n = cut(rest.p, rest.n, [&](V3 p) { return height(i, p); });
        return rest;
    }
    Polygon clip(const Triangle& t) const {
        uint32_t a = outside(t.a), b = outside(t.b), c = outside(t.c);
        return a & b & c ? Polygon() : clip(t, a | b | c);
    }
};

// Where a ray enters and leaves a box about the origin; fmin and fmax pass over NAN, of a ray in a face.
inline void slab(V3 start, V3 ray, V3 half, double& enter, double& leave) {
    V3 a = -1.0 * (half + start), b = half - start;
    double from[3] = {a.x / ray.x, a.y / ray.y, a.z / ray.z}, to[3] = {b.x / ray.x, b.y / ray.y, b.z / ray.z};
    enter = -INFINITY, leave = INFINITY;
    for (int k = 0; k < 3; k++) enter = fmax(enter, fmin(from[k], to[k])), leave = fmin(leave, fmax(from[k], to[k]));
}

constexpr int BOX_FACES[6][4] = {{0, 1, 3, 2}, {4, 6, 7, 5}, {0, 4, 5, 1}, {2, 3, 7, 6}, {0, 2, 6, 4}, {1, 5, 7, 3}};

// Walks down the tree of a surface: into the nodes for which `enter(node, planes)` is true, which may take from the
// planes, to `leaf(node, planes)`; ends with true as soon as a leaf is.
template <class Enter, class Leaf> bool walk(const Surface& s, uint32_t planes, Enter enter, Leaf leaf) {
    struct Open { int node; uint32_t planes; } open[DEEPEST];
    int size = 0;
    open[size++] = {0, planes};
    while (size) {
        Open now = open[--size];
        const Node& n = s.nodes[now.node];
        if (!enter(n, now.planes)) continue;
        if (!n.count) open[size++] = {n.first + 1, now.planes}, open[size++] = {n.first, now.planes};
        else if (leaf(n, now.planes)) return true;
    }
    return false;
}

// Whether a surface reaches into a hull, both in the frame of the solid's parent. full: whether the solid is full inside.
inline bool meets_surface(const Surface& s, const Hull& H, bool full) {
    bool inside = false;
    auto enter = [&](const Node& n, uint32_t& planes) {
        if (inside || !H.may_meet(n, planes)) return false;
        inside |= !planes;  // all of the node
        return true;
    };
    auto leaf = [&](const Node& n, uint32_t) {
        for (int i = n.first; i < n.first + n.count; i++)
            if (H.clip(s.triangles[i]).n) return true;
        return false;
    };
    if (walk(s, H.all(), enter, leaf) || inside) return true;
    for (int i = 0; full && i < s.count(); i++)  // or it is around all of the hull
        full = dot(s.normals[i], H.eye() - s.triangles[i].a) <= 0;
    return full;
}

// Whether a solid reaches into a hull, by its exact form; the hull is in the frame of the solid's parent.
inline bool meets(const Solid& solid, const Hull& H) {
    if (solid.form == Form::mesh || solid.form == Form::box) return meets_surface(solid.surface, H, solid.is_full());
    return distance(Piece::of(H.point, 9), Piece::of(solid, solid.X_PG), 0, 0) <= 0;
}

// The least factor of a ray, below `best`, at which it meets a surface. A line meets a triangle if its products with all
// three sides have one sign (K. Shoemake 1998).
inline double first_hit(const Surface& s, V3 from, V3 ray, double best) {
    auto enter = [&](const Node& n, uint32_t) {
        double in, out;
        slab(from - n.center, ray, n.extent, in, out);
        return most(in, 0.0) <= least(out, best);
    };
    auto leaf = [&](const Node& n, uint32_t) {
        for (int i = n.first; i < n.first + n.count; i++) {
            V3 p = s.triangles[i].a - from, q = s.triangles[i].b - from, r = s.triangles[i].c - from;
            double u = dot(cross(p, q), ray), v = dot(cross(q, r), ray), w = dot(cross(r, p), ray);
            if (!((u >= 0 && v >= 0 && w >= 0) || (u <= 0 && v <= 0 && w <= 0))) continue;
            double slope = dot(s.normals[i], ray), factor = slope == 0 ? -1 : dot(s.normals[i], p) / slope;
            if (factor > 0 && factor < best) best = factor;
        }
        return false;
    };
    walk(s, 0, enter, leaf);
    return best;
}

// The least distance from the eye, below `best`, of the part of a surface that is inside a hull.
inline double nearest_inside(const Surface& s, const Hull& H, double best) {
    auto enter = [&](const Node& n, uint32_t) {
        uint32_t planes = H.all();
        return norm(highest(size_of(H.eye() - n.center) - n.extent, {0, 0, 0})) < best && H.may_meet(n, planes);
    };
    auto leaf = [&](const Node& n, uint32_t) {
        for (int i = n.first; i < n.first + n.count; i++) {
            Polygon rest = H.clip(s.triangles[i]);
            V3 eye = H.eye();
            if (rest.n) best = least(best, distance(Piece::of(&eye, 1), Piece::of(rest.p, rest.n), ENDLESS, 0));
        }
        return false;
    };
    walk(s, 0, enter, leaf);
    return best;
}
