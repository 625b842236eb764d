# m.sh NAME pytest-args: whole cost by reap, with draws logged
. /work/env.sh draw; export OPENBLAS_NUM_THREADS=1
n=$1; shift; rm -f /tmp/draw/$n.draws
DRAWLOG=/tmp/draw/$n.draws PYTHONPATH=/work/wt/draw:/tmp/draw python /tmp/fast/reap.py python -m pytest -p no:xdist -q -m "not trial" --override-ini "addopts=--import-mode=importlib -q" --durations=8 "$@" 2>&1 | tail -14
awk '{n[$1]++; c[$1]+=$2; b[$1]+=($1~/start/)?$3:0} END{for(k in n) printf "%s n %d cpu %.2f (before %.2f) each %.4f\n",k,n[k],c[k],b[k],c[k]/n[k]}' /tmp/draw/$n.draws 2>/dev/null
