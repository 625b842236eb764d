// How much of a box is visible: the share of its silhouette, on a grid of rays in the undistorted image
// (docs/reference/numbers.md, "Visible"). A ray is blocked if a triangle lies on it before it leaves the box.
#pragma once
#include "hull.hpp"

constexpr int ROWS = 64, COLUMNS = 32;
constexpr double AHEAD = 1e-6;      // depth from which on a point counts as in front of the eye [m]
constexpr double USUAL_AXIS = 0.5;  // angle of the rows to the image's, so that upright edges cross rows and columns [rad]
constexpr double LONG = 2;          // ratio of the spreads of a box's corners from which on the rows run across its longer axis
constexpr double GOLDEN = 0.61803398874989484820;  // (sqrt(5) - 1) / 2

// How far each row is shifted, as a share of a column, so that the rays form no columns.
inline double shift(int row) { return row * GOLDEN - int(row * GOLDEN); }

// The first whole number that is not below a place in the grid.
inline int up(double v) { int t = int(v); return t + (v > t); }
inline int first_row(double v) { return up(clamp(v, 0, ROWS)); }
inline int first_column(double v) { return up(clamp(v, 0, COLUMNS)); }

// How many bits are set (Warren, Hacker's Delight, 2012, 5-1); not every processor has an instruction for it.
inline int bits(uint32_t x) {
    x -= x >> 1 & 0x55555555u, x = (x & 0x33333333u) + (x >> 2 & 0x33333333u), x = (x + (x >> 4)) & 0x0f0f0f0fu;
    return int(x * 0x01010101u >> 24);
}

// A set of rays: one bit for each column in each row.
struct Rays {
    uint32_t row[ROWS] = {};
    Rays operator|(const Rays& o) const { Rays all; for (int i = 0; i < ROWS; i++) all.row[i] = row[i] | o.row[i]; return all; }
    int count_without(const Rays& o) const { int n = 0; for (int i = 0; i < ROWS; i++) n += bits(row[i] & ~o.row[i]); return n; }

    // Adds those through the rectangle around a node, a trifle wider; map: see `add`.
    void add_around(const Pose& map, const Node& n) {
        Bounds all;
        bool ahead = true;
        for (int i = 0; i < 8; i++) {
            V3 p = map(n.center + corner(i, n.extent));
            ahead &= p.z > AHEAD, all.add(flat(p));
        }
        double least_c = ahead ? all.low.x - 1e-6 : 0, most_c = ahead ? all.high.x + 1e-6 : COLUMNS;
        int from = ahead ? first_row(all.low.y - 1e-6) : 0, to = ahead ? first_row(all.high.y + 1e-6) : ROWS;
        for (int k = from; k < to; k++)
            row[k] |= uint32_t((1ull << first_column(most_c - shift(k))) - 1) & ~uint32_t((1ull << first_column(least_c - shift(k))) - 1);
    }

    // Adds those that meet a flat convex polygon; map: into column and row, both times depth, and depth.
    void add(const Pose& map, const V3* p, int n) {
        V3 q[CORNERS];
        double c[CORNERS], r[CORNERS];
        Bounds all;
        bool ahead = true;
        for (int i = 0; i < n; i++) q[i] = map(p[i]), ahead &= q[i].z >= AHEAD;
        if (!ahead) n = cut(q, n, [](V3 v) { return AHEAD - v.z; });
        for (int i = 0; i < n; i++) c[i] = q[i].x / q[i].z, r[i] = q[i].y / q[i].z, all.add({c[i], r[i], 0});
        int from = first_row(all.low.y), to = first_row(all.high.y);
        if (!n || from >= to || all.high.x <= 0 || all.low.x >= COLUMNS) return;
        uint32_t rising[ROWS], falling[ROWS];  // the rays left of either flank
        for (int i = 0; i < n; i++) {
            int j = i + 1 == n ? 0 : i + 1;
            bool rises = r[j] > r[i];
            int p = rises ? i : j, q = rises ? j : i, start = first_row(r[p]), end = first_row(r[q]);
            if (start >= end) continue;
            double slope = (c[q] - c[p]) / (r[q] - r[p]), at = c[p] - r[p] * slope;
            for (int k = start; k < end; k++) (rises ? rising : falling)[k] = uint32_t((1ull << first_column(at + k * slope - shift(k))) - 1);
        }
        for (int k = from; k < to; k++) row[k] |= rising[k] ^ falling[k];
    }
};

// The rays that closed outlines wind around: each edge is a step at the first ray beyond it in the rows that it crosses.
struct Winding {
    int16_t step[COLUMNS + 1][ROWS] = {};
    void add_edge(V3 a, V3 b, int weight) {  // mapped
        double r0 = a.y / a.z, r1 = b.y / b.z;
        int from = first_row(r0), to = first_row(r1);
        if (from == to) return;
        double c0 = a.x / a.z, c1 = b.x / b.z, slope = (c1 - c0) / (r1 - r0), at = c0 - r0 * slope;
        if (least(c0, c1) > COLUMNS + 1) return;  // beyond all rays
        if (to < from) swap(from, to), weight = -weight;
        for (int k = from; k < to; k++) step[first_column(at + k * slope - shift(k))][k] += int16_t(weight);
    }
    void fill(Rays& rays) const {
        int16_t sum[ROWS] = {};
        for (int c = 0; c < COLUMNS; c++)
            for (int k = 0; k < ROWS; k++) sum[k] += step[c][k], rays.row[k] |= sum[k] != 0 ? 1u << c : 0u;
    }
};

// The rays of an eye to a box, through the rectangle around its image in the plane z = 1, turned.
struct Grid {
    Pose map;         // from the world into column and row, both times depth, and depth
    Rays silhouette;  // those that run to the box
    int total = 0;    // how many these are
    V3 low;           // the rectangle's corner
    double step_u, step_v, sine, cosine;

    static Grid of(const Hull& H, const Pose& X_WC) {
        Grid G;
        double along = 0, across = 0, mixed = 0;
        V3 seen[8], middle{0, 0, 0};
        for (int i = 0; i < 8; i++) seen[i] = flat(X_WC.back(H.point[i])), middle = middle + 0.125 * seen[i];
        for (V3 p : seen) p = p - middle, along += p.x * p.x, across += p.y * p.y, mixed += p.x * p.y;
        double spread = hypot(along - across, 2 * mixed);
        bool is_long = along + across + spread > LONG * LONG * (along + across - spread);
        double angle = is_long ? 0.5 * atan2(2 * mixed, along - across) : USUAL_AXIS;
        G.sine = sin(angle), G.cosine = cos(angle);
        V3 o = X_WC.origin(), x = X_WC.axis(0), y = X_WC.axis(1), z = X_WC.axis(2);
        V3 right = G.sine * x - G.cosine * y, down = G.cosine * x + G.sine * y;
        Bounds all;
        for (int i = 0; i < 8; i++) all.add(flat({dot(right, H.point[i] - o), dot(down, H.point[i] - o), dot(z, H.point[i] - o)}));
        G.low = all.low, G.step_u = (all.high.x - all.low.x) / COLUMNS, G.step_v = (all.high.y - all.low.y) / ROWS;
        V3 c = (1 / G.step_u) * (right - G.low.x * z), r = (1 / G.step_v) * (down - G.low.y * z) - 0.5 * z;
        G.map = {{c.x, c.y, c.z, -dot(c, o), r.x, r.y, r.z, -dot(r, o), z.x, z.y, z.z, -dot(z, o)}};
        for (auto& face : BOX_FACES) {
            V3 p[4] = {H.point[face[0]], H.point[face[1]], H.point[face[2]], H.point[face[3]]};
            if (dot(cross(p[1] - p[0], p[3] - p[0]), o - p[0]) > 0) G.silhouette.add(G.map, p, 4);  // turned to the eye
        }
        G.total = G.silhouette.count_without({});
        return G;
    }

    // Where a ray is in the plane z = 1 of the camera, not turned.
    V3 direction(int row, int column) const {
        double u = low.x + step_u * (column + shift(row)), v = low.y + step_v * (row + 0.5);
        return {sine * u + cosine * v, -cosine * u + sine * v, 1};
    }

    // The share of the box that is seen where these rays are blocked; without area in the image nothing hides it.
    double seen(const Rays& blocked) const { return total ? double(silhouette.count_without(blocked)) / total : 1.0; }
};

struct Share { double seen; int near; Rays around; };  // the least that a near solid leaves of a box; the rays that it may block

// Memory that a call uses again and again.
struct Scratch {
    List<int8_t> turned;     // of each triangle: 1 and -1 of those whose outline is drawn, turned to the eye or away; else 0
    List<int32_t> drawn;     // these
    List<Share> rest;
};

// Calls `whole(i, side)` for the triangles that may block rays to a box and lie before its far side, and
// `part(i, planes)` for those of which only what is inside these planes does. H, map: in the frame of the surface.
template <class Whole, class Part> void for_blocking(const Surface& s, const Hull& H, const Pose& map, Whole whole, Part part) {
    auto enter = [&](const Node& n, uint32_t& planes) { return !planes || H.may_meet(n, planes); };
    auto leaf = [&](const Node& n, uint32_t planes) {
        bool ahead = map(n.center).z - map.around(n.extent).z > AHEAD;
        for (int i = n.first; i < n.first + n.count; i++) {
            const Triangle& t = s.triangles[i];
            int8_t side = dot(s.normals[i], H.eye() - t.a) > 0 ? 1 : -1;
            uint32_t through = 0;
            if (planes & H.far || !ahead) {
                uint32_t a = H.outside(t.a), b = H.outside(t.b), c = H.outside(t.c);
                if (a & b & c) continue;
                through = (a | b | c) & H.far;
            }
            if (ahead && !through) whole(i, side);
            else part(i, through);
        }
        return false;
    };
    walk(s, H.all(), enter, leaf);
}

// Adds the rays that a surface blocks. Of triangles wholly before the far side only the common outline is drawn: sides of
// which only one triangle is among them, or which are between front and back. H, map: in the frame of the surface.
inline void block(Rays& blocked, const Surface& s, const Hull& H, const Pose& map, Scratch& scratch) {
    List<int8_t>& turned = scratch.turned;
    List<int32_t>& drawn = scratch.drawn;
    if (turned.size() < s.count()) turned.resize(s.count());  // zeros
    drawn.clear();
    for_blocking(
        s, H, map, [&](int i, int8_t side) { turned[i] = side, drawn.add(i); },
        [&](int i, uint32_t through) {
            Polygon rest = H.clip(s.triangles[i], through);
            if (rest.n) blocked.add(map, rest.p, rest.n);
        });
    if (drawn.empty()) return;
    Winding winding;
    for (int32_t i : drawn) {
        const Triangle& t = s.triangles[i];
        const V3* p[4] = {&t.a, &t.b, &t.c, &t.a};
        for (int k = 0; k < 3; k++) {
            int j = s.beside[3 * i + k], weight = turned[i] - (j < 0 ? 0 : turned[j]);
            if (weight && !(j > i && turned[j])) winding.add_edge(map(*p[k]), map(*p[k + 1]), weight);
        }
    }
    for (int32_t i : drawn) turned[i] = 0;
    winding.fill(blocked);
}

// How far along each ray something is, at which it is blocked: its depth, or `ENDLESS`.
struct Depths {
    double of[ROWS][COLUMNS];
    Depths() { for (auto& row : of) for (double& depth : row) depth = ENDLESS; }
};

// Lowers the depths of the rays that a surface blocks; see `block`.
inline void block(Depths& depths, const Grid& grid, const Surface& s, const Hull& H, const Pose& map) {
    auto draw = [&](int i, uint32_t planes) {
        Polygon rest = H.clip(s.triangles[i], planes);
        if (!rest.n) return;
        Rays met;
        met.add(map, rest.p, rest.n);
        // In the grid, where points are (column, row, 1) times depth, the triangle's plane is n . p = n . a.
        V3 a = map(s.triangles[i].a), n = cross(map(s.triangles[i].b) - a, map(s.triangles[i].c) - a);
        for (int k = 0; k < ROWS; k++)
            for (uint32_t left = met.row[k] & grid.silhouette.row[k]; left; left &= left - 1) {
                int c = __builtin_ctz(left);
                double slope = dot(n, {c + shift(k), double(k), 1});
                if (slope != 0) depths.of[k][c] = least(depths.of[k][c], dot(n, a) / slope);
            }
    };
    for_blocking(s, H, map, [&](int i, int8_t) { draw(i, 0); }, draw);
}
