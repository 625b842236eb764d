// A run in the simulated cell, as it happens: what images show, alarms, and the images themselves.

class Runs {
  constructor(send) {
    this.send = send;
  }
}
