// The numbers of what is selected, to type: metres and degrees.

const DEGREE = Math.PI / 180;

class Fields {
  // changed(move): numbers were typed.
  constructor(changed) {
    this.changed = changed;
    this.rows = new Map();
  }

  show(move) {
    const same = this.move?.kind === move.kind && this.move?.name === move.name;
    this.move = structuredClone(move);
    if (!same) this.build();
    this.fill();
  }

  build() {
    const { kind } = this.move;
    const rows = [['position', 'position [m]', 3, 1, 0.01]];
    if (kind === 'camera') rows.push(['look_at', 'looks at [m]', 3, 1, 0.01], ['fov', 'view angle [deg]', 1, DEGREE, 1]);
    else rows.push(['yaw', 'turned by [deg]', 1, DEGREE, 5]);
    this.rows = new Map(
      rows.map(([key, title, count, unit, step]) => {
        const inputs = Array.from({ length: count }, (_, axis) =>
          make('input', {
            type: 'number',
            step,
            'aria-label': count > 1 ? `${title}, ${'xyz'[axis]}` : title,
            onchange: () => this.typed(key),
          }),
        );
        return [key, { inputs, unit, title }];
      }),
    );
    byId('fields').replaceChildren(
      ...[...this.rows.values()].map(({ inputs, title }) =>
        make('div', { class: 'field' }, make('span', {}, title), ...inputs),
      ),
    );
  }

  // Numbers that are being typed stay.
  fill() {
    for (const [key, { inputs, unit }] of this.rows)
      inputs.forEach((input, axis) => {
        if (document.activeElement === input && input.dataset.typing) return;
        const value = inputs.length > 1 ? this.move[key][axis] : this.move[key];
        input.value = String(+(value / unit).toFixed(unit === 1 ? 4 : 3));
      });
  }

  typed(key) {
    const { inputs, unit } = this.rows.get(key),
      values = inputs.map((input) => input.valueAsNumber * unit);
    if (!values.every(Number.isFinite)) return this.fill();
    this.move[key] = inputs.length > 1 ? values : values[0];
    this.changed({ ...this.move });
  }
}
