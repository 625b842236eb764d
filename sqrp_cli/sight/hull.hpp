// The view hull of a box: the convex hull of an eye and the box's corners. What reaches into it hides some of the box
// (docs/reference/numbers.md, "Visible").
#pragma once
#include "surface.hpp"

constexpr int PLANES = 12;           // of a hull: at most 5 faces of the box, and at most 6 beside it; padded
constexpr int CORNERS = 24;          // room for a triangle cut by all of them, which has 3 + 12 corners
constexpr double TOUCH = 1e-9;       // bounds that are nearer than this count as touching [m]
constexpr double LEAST_DEPTH = 1e-6;  // of the box's nearest corner; nearer ones have no bounded image [m]

struct Polygon { V3 p[CORNERS]; int n = 0; };

// A hull as half spaces: points p with n . p <= offset are inside.
struct Hull {
    double x[PLANES], y[PLANES], z[PLANES], offset[PLANES];
    int count = 0;
    uint32_t far = 0;                // which planes are faces of the box that are turned away from the eye: its far side
    V3 point[9];                     // the box's corners, x slowest, and the eye
    V3 axis;                         // of a cone around the hull, from the eye
    double cosine, sine, length;     // of half the cone's opening; its length

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
        for (int i = 0; i < 8; i++) H.point[i] = X_WB(corner(i, half) + middle);
        H.point[8] = eye_W;
        H.wrap();
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
        for (int i = 0; i < 9; i++) L.point[i] = X_WP.back(point[i]);
        return L;  // without its cone
    }

    double height(int i, V3 p) const { return x[i] * p.x + y[i] * p.y + z[i] * p.z - offset[i]; }

    // Which planes a point is outside of.
    uint32_t outside(V3 p) const {
        uint32_t out = 0;
        for (int i = 0; i < PLANES; i++) out |= uint32_t(height(i, p) > 0) << i;
        return out;
    }

    // Whether the bounds of a solid may reach in: its ball into the cone and into each half space, then its box.
    bool may_meet(const Solid& solid, const Pose& X_WP) const {
        V3 center = X_WP(solid.center), d = center - eye();
        double radius = solid.radius + TOUCH, along = dot(d, axis), aside = sqrt(most(0.0, dot(d, d) - along * along));
        if (along < -radius || along > radius + length || aside * cosine - along * sine > radius) return false;
        double beyond = -ENDLESS;
        for (int i = 0; i < PLANES; i++) beyond = most(beyond, height(i, center));
        if (beyond > radius) return false;
        const Node& root = solid.root();
        V3 middle = X_WP(root.center), side[3] = {root.extent.x * X_WP.axis(0), root.extent.y * X_WP.axis(1), root.extent.z * X_WP.axis(2)};
        for (V3 s : side) {
            double low = ENDLESS, high = -ENDLESS, reach = dot(s, s), slack = TOUCH * sqrt(reach);
            for (V3 p : point) low = least(low, dot(p - middle, s)), high = most(high, dot(p - middle, s));
            if (low > reach + slack || high < -reach - slack) return false;
        }
        uint32_t out = 0;
        for (int i = 0; i < PLANES; i++) {
            double reach = 0;
            for (V3 s : side) reach += fabs(x[i] * s.x + y[i] * s.y + z[i] * s.z);
            out |= uint32_t(height(i, middle) - reach > TOUCH) << i;
        }
        return !out;
    }

    // Whether a node may reach in. `planes` loses those of which all of the node is inside.
    bool may_meet(const Node& n, uint32_t& planes) const {
        double low[PLANES], high[PLANES];
        for (int i = 0; i < PLANES; i++) {
            double d = height(i, n.center), r = fabs(x[i]) * n.extent.x + fabs(y[i]) * n.extent.y + fabs(z[i]) * n.extent.z;
            low[i] = d - r, high[i] = d + r;
        }
        uint32_t out = 0, in = 0;
        for (int i = 0; i < PLANES; i++) out |= uint32_t(low[i] > 0) << i, in |= uint32_t(high[i] <= 0) << i;
        planes &= ~in;
        return !out;
    }

    // The part of a triangle that is inside some of the planes (Sutherland and Hodgman 1974).
    Polygon clip(const Triangle& t, uint32_t planes) const {
        Polygon from{{t.a, t.b, t.c}, 3};
        for (int i = 0; i < count && from.n; i++) {
            if (!(planes >> i & 1)) continue;
            Polygon to;
            for (int j = 0; j < from.n && to.n + 2 <= CORNERS; j++) {
                V3 a = from.p[j], b = from.p[j + 1 == from.n ? 0 : j + 1];
                double p = height(i, a), q = height(i, b);
                if (p <= 0) to.p[to.n++] = a;
                if ((p > 0) != (q > 0)) to.p[to.n++] = a + (p / (p - q)) * (b - a);
            }
            from = to;
        }
        return from;
    }

private:
    void wrap() {
        axis = {0, 0, 0};
        for (int i = 0; i < 8; i++) axis = axis + (point[i] - eye());
        axis = unit(axis), cosine = 1, length = 0;
        bool bounded = true;
        for (int i = 0; i < 8; i++) {
            V3 ray = point[i] - eye();
            double depth = dot(ray, axis);
            bounded &= depth > LEAST_DEPTH;
            cosine = least(cosine, depth / norm(ray)), length = most(length, depth);
        }
        if (!bounded) cosine = sine = 0, length = ENDLESS;
        else sine = sqrt(most(0.0, 1 - cosine * cosine));
    }
};

inline double distance_to_segment(V3 p, V3 a, V3 b) {
    V3 side = b - a;
    return norm(a - p + clamp(dot(p - a, side) / most(dot(side, side), 1e-300), 0, 1) * side);
}

// Distance of a point from a flat convex polygon.
inline double distance_to_polygon(V3 from, const V3* p, int n, V3 normal) {
    double size = dot(normal, normal), best = ENDLESS;
    if (n > 2 && size > 1e-30) {
        V3 foot = from + (dot(p[0] - from, normal) / size) * normal;
        bool ahead = true, behind = true;
        for (int i = 0; i < n; i++) {
            double turn = dot(cross(p[(i + 1) % n] - p[i], foot - p[i]), normal);
            ahead &= turn >= 0, behind &= turn <= 0;
        }
        if (ahead || behind) return norm(foot - from);
    }
    for (int i = 0; i < n; i++) best = least(best, distance_to_segment(from, p[i], p[(i + 1) % n]));
    return best;
}

// Distance between two segments (Ericson, Real-Time Collision Detection, 2005, 5.1.9).
inline double distance_of_segments(V3 a, V3 b, V3 c, V3 d) {
    V3 u = b - a, v = d - c, w = a - c;
    double uu = dot(u, u), vv = dot(v, v), uv = dot(u, v), uw = dot(u, w), vw = dot(v, w), apart = uu * vv - uv * uv;
    double best = least(least(distance_to_segment(a, c, d), distance_to_segment(b, c, d)), least(distance_to_segment(c, a, b), distance_to_segment(d, a, b)));
    if (apart <= 1e-12 * uu * vv) return best;  // parallel: an end is nearest
    double s = (uv * vw - vv * uw) / apart, t = (uu * vw - uv * uw) / apart;
    return s < 0 || s > 1 || t < 0 || t > 1 ? best : least(best, norm(w + s * u - t * v));
}

constexpr int BOX_FACES[6][4] = {{0, 1, 3, 2}, {4, 6, 7, 5}, {0, 4, 5, 1}, {2, 3, 7, 6}, {0, 2, 6, 4}, {1, 5, 7, 3}};

// Whether a ball swept along the segment a-b, all in the hull's frame, reaches into a hull.
inline bool meets_capsule(const Hull& H, V3 a, V3 b, double radius) {
    double from = 0, to = 1;  // the part of the segment that is inside
    for (int i = 0; i < H.count; i++) {
        double p = H.height(i, a), q = H.height(i, b);
        if (p > 0 && q > 0) from = 2;
        else if (p > 0) from = most(from, p / (p - q));
        else if (q > 0) to = least(to, p / (p - q));
    }
    if (from <= to) return true;
    // Else nearest are an end of the segment and a face, or the segment and an edge; all of these lie in the hull.
    V3 e = H.eye();
    for (int i = 0; i < 8; i++) {
        if (distance_of_segments(a, b, e, H.point[i]) <= radius) return true;
        for (int bit = 1; bit < 8; bit *= 2) {
            int j = i | bit;
            if (j == i) continue;
            V3 side[3] = {H.point[i], H.point[j], e}, normal = cross(side[1] - side[0], side[2] - side[0]);
            if (distance_of_segments(a, b, side[0], side[1]) <= radius) return true;
            if (distance_to_polygon(a, side, 3, normal) <= radius || distance_to_polygon(b, side, 3, normal) <= radius) return true;
        }
    }
    for (auto& face : BOX_FACES) {
        V3 p[4] = {H.point[face[0]], H.point[face[1]], H.point[face[2]], H.point[face[3]]}, normal = cross(p[1] - p[0], p[3] - p[0]);
        if (distance_to_polygon(a, p, 4, normal) <= radius || distance_to_polygon(b, p, 4, normal) <= radius) return true;
    }
    return false;
}

// Whether a cylinder about z reaches into a hull, both in the cylinder's frame. Seen along z, the part of the hull
// between its ends is the outline of the points where segments between the hull's corners run between them.
inline bool meets_cylinder(const Hull& H, double radius, double half) {
    V3 p[9 + 2 * 36], around[2 * (9 + 2 * 36)];
    int n = 0;
    for (int i = 0; i < 9; i++) {
        if (fabs(H.point[i].z) <= half) p[n++] = H.point[i];
        for (int j = 0; j < i; j++)
            for (int k = 0; k < 2; k++) {
                V3 a = H.point[i], b = H.point[j];
                double end = k ? half : -half;
                if ((a.z < end) != (b.z < end)) p[n++] = a + ((end - a.z) / (b.z - a.z)) * (b - a);
            }
    }
    for (int i = 0; i < n; i++) p[i].z = 0;
    return n && distance_to_polygon({0, 0, 0}, around, outline(p, n, around), {0, 0, 1}) <= radius;
}

// Whether a surface reaches into a hull, both in the frame of the solid's parent. full: whether the solid is full inside.
inline bool meets_surface(const Surface& s, const Hull& H, bool full) {
    V3 low = H.point[0], high = low;
    for (V3 p : H.point) low = lowest(low, p), high = highest(high, p);
    struct Open { int node; uint32_t planes; } open[DEEPEST];
    int size = 0;
    open[size++] = {0, H.all()};
    while (size) {
        Open now = open[--size];
        const Node& n = s.nodes[now.node];
        V3 from = n.center - n.extent, to = n.center + n.extent;
        if (from.x > high.x || from.y > high.y || from.z > high.z || to.x < low.x || to.y < low.y || to.z < low.z) continue;
        if (!H.may_meet(n, now.planes)) continue;
        if (!now.planes) return true;
        if (!n.count) {
            open[size++] = {n.first + 1, now.planes}, open[size++] = {n.first, now.planes};
            continue;
        }
        for (int i = n.first; i < n.first + n.count; i++) {
            const Triangle& t = s.triangles[i];
            uint32_t a = H.outside(t.a), b = H.outside(t.b), c = H.outside(t.c);
            if (!(a & b & c) && (!a || !b || !c || H.clip(t, a | b | c).n)) return true;
        }
    }
    if (!full) return false;
    for (int i = 0; i < s.count(); i++)  // or it is around all of the hull
        if (dot(s.normals[i], H.eye() - s.triangles[i].a) > 0) return false;
    return true;
}

// Whether a solid reaches into a hull, by its exact form; the hull is in the frame of the solid's parent.
inline bool meets(const Solid& solid, const Hull& H) {
    V3 up = solid.half.z * solid.X_PG.axis(2), o = solid.X_PG.origin();
    if (solid.form == Form::sphere || solid.form == Form::capsule) return meets_capsule(H, o - up, o + up, solid.half.x);
    if (solid.form == Form::cylinder) return meets_cylinder(H.in(solid.X_PG), solid.half.x, solid.half.z);
    return meets_surface(solid.surface, H, solid.is_full());
}

// The least factor of a ray, below `best`, at which it meets a surface. A line meets a triangle if its products with all
// three sides have one sign (K. Shoemake 1998).
inline double first_hit(const Surface& s, V3 from, V3 ray, double best) {
    auto turned = [](double v) { return 1 / (v == 0 ? 1e-300 : v); };
    V3 by{turned(ray.x), turned(ray.y), turned(ray.z)};
    int open[DEEPEST], size = 0;
    open[size++] = 0;
    while (size) {
        const Node& n = s.nodes[open[--size]];
        V3 a = n.center - n.extent - from, b = n.center + n.extent - from;
        a = {a.x * by.x, a.y * by.y, a.z * by.z}, b = {b.x * by.x, b.y * by.y, b.z * by.z};
        V3 in = lowest(a, b), out = highest(a, b);
        if (most(most(in.x, in.y), most(in.z, 0.0)) > least(least(out.x, out.y), least(out.z, best))) continue;
        if (!n.count) {
            open[size++] = n.first, open[size++] = n.first + 1;
            continue;
        }
        for (int i = n.first; i < n.first + n.count; i++) {
            V3 p = s.triangles[i].a - from, q = s.triangles[i].b - from, r = s.triangles[i].c - from;
            double u = dot(cross(p, q), ray), v = dot(cross(q, r), ray), w = dot(cross(r, p), ray);
            if (!((u >= 0 && v >= 0 && w >= 0) || (u <= 0 && v <= 0 && w <= 0))) continue;
            double slope = dot(s.normals[i], ray), factor = slope == 0 ? -1 : dot(s.normals[i], p) / slope;
            if (factor > 0 && factor < best) best = factor;
        }
    }
    return best;
}

// The least distance from the eye, below `best`, of the part of a surface that is inside a hull.
inline double nearest_inside(const Surface& s, const Hull& H, double best) {
    struct Open { int node; double near; } open[DEEPEST];
    auto near = [&](int i) {
        V3 d = H.eye() - s.nodes[i].center, e = s.nodes[i].extent;
        return norm({most(0.0, fabs(d.x) - e.x), most(0.0, fabs(d.y) - e.y), most(0.0, fabs(d.z) - e.z)});
    };
    int size = 0;
    open[size++] = {0, near(0)};
    while (size) {
        Open now = open[--size];
        const Node& n = s.nodes[now.node];
        uint32_t planes = H.all();
        if (now.near >= best || !H.may_meet(n, planes)) continue;
        if (!n.count) {
            Open a{n.first, near(n.first)}, b{n.first + 1, near(n.first + 1)};
            if (a.near < b.near) swap(a, b);
            open[size++] = a, open[size++] = b;
            continue;
        }
        for (int i = n.first; i < n.first + n.count; i++) {
            const Triangle& t = s.triangles[i];
            uint32_t a = H.outside(t.a), b = H.outside(t.b), c = H.outside(t.c);
            if (a & b & c) continue;
            Polygon rest = H.clip(t, a | b | c);
            if (rest.n) best = least(best, distance_to_polygon(H.eye(), rest.p, rest.n, s.normals[i]));
        }
    }
    return best;
}
