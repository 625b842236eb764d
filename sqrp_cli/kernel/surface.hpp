// Solids: triangle surfaces with a tree of boxes over them, and the exact forms of round ones.
#pragma once
#include "base.hpp"

struct Triangle {
    V3 a, b, c;
    void widen(Bounds& all) const { all.add(a), all.add(b), all.add(c); }
};

// A box along the axes around all triangles below it. Of a leaf: `count` triangles from `first` on, in the order of the
// tree; else `count` is 0, and its two children are the nodes `first` and `first + 1`.
struct Node { V3 center, extent; int first, count; };

constexpr double SAME_PLACE = 1e9;  // points whose coordinates agree when rounded to a billionth of a metre are one
constexpr int LEAF = 16;            // most triangles of a leaf
constexpr int DEEPEST = 64;         // nodes that a walk keeps: children halve the triangles, so 32 are enough for 2^31

struct Surface {
    List<Node> nodes;
    List<Triangle> triangles;
    List<V3> normals;       // of each triangle, out of the front, as long as twice its area
    List<int32_t> beside;   // of its sides a-b, b-c and c-a: the only other triangle at that side, if it runs against it, else -1

    int count() const { return triangles.size(); }

    // vertices: n points; faces: three of them each, counter-clockwise seen from outside.
    void build(const double* vertices, int n, const int64_t* faces, int face_count) {
        List<V3> points;
        List<int32_t> place, corners;
        merge(vertices, n, points, place);
        for (int i = 0; i < face_count; i++) {
            const int64_t* f = faces + 3 * i;
            triangles.add({points[place[int(f[0])]], points[place[int(f[1])]], points[place[int(f[2])]]});
        }
        List<int32_t> order;
        grow(order);
        for (int32_t i : order)
            for (int k = 0; k < 3; k++) corners.add(place[int(faces[3 * i + k])]);
        for (const Triangle& t : triangles) normals.add(cross(t.b - t.a, t.c - t.a));
        join(corners, points.size());
    }

private:
    // Which points there are, and which of them each vertex is.
    static void merge(const double* vertices, int n, List<V3>& points, List<int32_t>& place) {
        struct Key { int64_t x, y, z; int32_t vertex; };
        List<Key> keys;
        auto whole = [](double v) { return int64_t(llrint(v * SAME_PLACE)); };
        for (int i = 0; i < n; i++) keys.add({whole(vertices[3 * i]), whole(vertices[3 * i + 1]), whole(vertices[3 * i + 2]), i});
        sort(keys.begin(), keys.end(), [](const Key& a, const Key& b) { return a.x != b.x ? a.x < b.x : a.y != b.y ? a.y < b.y : a.z < b.z; });
        place.resize(n);
        for (int i = 0; i < n; i++) {
            const double* v = vertices + 3 * keys[i].vertex;
            if (!i || keys[i].x != keys[i - 1].x || keys[i].y != keys[i - 1].y || keys[i].z != keys[i - 1].z) points.add({v[0], v[1], v[2]});
            place[keys[i].vertex] = points.size() - 1;
        }
    }

    // Finds `beside`: sides that exactly two triangles share, in opposite directions.
    void join(const List<int32_t>& corners, int point_count) {
        struct Side { int64_t key; int32_t at; };
        List<Side> sides;
        auto next = [](int i) { return i % 3 == 2 ? i - 2 : i + 1; };
        beside.resize(corners.size());
        for (int i = 0; i < corners.size(); i++) {
            int64_t a = corners[i], b = corners[next(i)];
            sides.add({least(a, b) * point_count + most(a, b), i}), beside[i] = -1;
        }
        sort(sides.begin(), sides.end(), [](const Side& a, const Side& b) { return a.key < b.key; });
        for (int i = 0, j; i < sides.size(); i = j) {
            for (j = i; j < sides.size() && sides[j].key == sides[i].key; j++) {}
            int one = sides[i].at, other = sides[j - 1].at;
            if (j - i == 2 && corners[one] != corners[other]) beside[one] = other / 3, beside[other] = one / 3;
        }
    }

    // Builds the tree, halving at the median along the longest side, and puts the triangles into its order.
    void grow(List<int32_t>& order) {
        List<V3> middle;
        for (int i = 0; i < count(); i++) {
            Bounds all;
            triangles[i].widen(all), order.add(i), middle.add(all.low + all.high);
        }
        struct Range { int node, from, to; };
        List<Range> open;
        open.add({0, 0, count()}), nodes.add({});
        while (!open.empty()) {
            Range now = open.take();
            Bounds all, middles;
            for (int i = now.from; i < now.to; i++) triangles[order[i]].widen(all), middles.add(middle[order[i]]);
            // A trifle wider than its triangles, so that no rounding leaves them outside.
            Node node{0.5 * (all.low + all.high), (0.5 * (1 + 1e-14)) * (all.high - all.low) + V3{1e-12, 1e-12, 1e-12}, now.from, now.to - now.from};
            if (node.count > LEAF) {
                V3 size = middles.high - middles.low;
                double V3::*along = size.x >= size.y && size.x >= size.z ? &V3::x : size.y >= size.z ? &V3::y : &V3::z;
                int half_way = (now.from + now.to) / 2;
                int32_t* all = order.begin();
                sort(all + now.from, all + now.to, [&](int32_t p, int32_t q) { return middle[p].*along < middle[q].*along; });
                node.first = nodes.size(), node.count = 0;
                nodes.add({}), nodes.add({});
                open.add({node.first, now.from, half_way}), open.add({node.first + 1, half_way, now.to});
            }
            nodes[now.node] = node;
        }
        List<Triangle> sorted;
        for (int32_t i : order) sorted.add(triangles[i]);
        for (int i = 0; i < count(); i++) triangles[i] = sorted[i];
    }
};

enum class Form { mesh, box, sphere, cylinder, capsule };

// A part of the cell, in the frame of its parent (a link, an object or the world).
struct Solid {
    Surface surface;   // of round forms, one of flat faces that encloses cylinders and is within 0.2 % of spheres and capsules
    Form form;
    Pose X_PG;         // of a form that is no mesh: boxes, cylinders and capsules are about their own centres, the latter along z
    V3 half;           // of a box: half its sides; else x: the radius, z: half the length of the straight part
    V3 center;         // of a ball around it
    double radius;

    // A mesh is its surface, other forms are full.
    bool is_full() const { return form != Form::mesh; }
};
