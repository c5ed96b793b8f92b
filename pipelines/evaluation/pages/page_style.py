"""How the pages of reports look: inline, light, one column, narrow screens too."""

STYLE = """
* { box-sizing: border-box }
body { font: 16px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; color: #1d2126;
  background: #fff; margin: 0 auto; max-width: 76rem; padding: 1.2rem 1rem 4rem }
h1 { font-size: 1.6rem; margin: .4rem 0 1rem }
h2 { font-size: 1.2rem; margin: 2.6rem 0 .8rem; padding-top: .6rem; border-top: 2px solid #e3e6ea }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(8.2rem, 1fr)); gap: .6rem }
.tiles div { background: #f5f7f9; border-radius: 8px; padding: .6rem .8rem }
.tiles b { display: block; font-size: 1.5rem; line-height: 1.2 }
.tiles span { display: block; font-size: .9rem }
.tiles small { color: #6a717b; font-size: .78rem }
.wide { overflow-x: auto; margin-top: 1.4rem }
table { border-collapse: collapse; font-size: .92rem; font-variant-numeric: tabular-nums }
caption { text-align: left; font-weight: 600; padding-bottom: .3rem; white-space: nowrap }
th, td { padding: .28rem .55rem; border-bottom: 1px solid #e3e6ea; text-align: right;
  white-space: nowrap }
th { color: #4a4f57; font-weight: 600 }
.name { text-align: left }
th:first-child, td:first-child { padding-left: 0 }
.paper td { color: #6a717b }
.note { color: #6a717b; font-size: .85rem; margin: .4rem 0 0; max-width: 46rem }
.columns { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 30rem), 1fr));
  gap: 0 2rem }
.columns > div { min-width: 0 }
figure { margin: 0 }
.charts { display: grid; grid-template-columns: repeat(auto-fit, minmax(17rem, 1fr)); gap: 1.2rem;
  margin-top: 1.4rem }
.chart { max-width: 30rem; margin-top: 1.4rem }
.charts .chart { margin-top: 0 }
.chart svg { width: 100%; height: auto }
.chart text { font-size: 12px; fill: #4a4f57 }
.chart figcaption { font-weight: 600; font-size: .92rem }
.legend { display: flex; flex-wrap: wrap; gap: .2rem 1rem; font-size: .82rem; color: #4a4f57 }
.legend svg { width: 26px; height: 8px; vertical-align: middle }
.legend.tall { margin: .8rem 0 }
.legend i { display: inline-block; width: .8rem; height: .8rem; border-radius: 2px;
  vertical-align: -1px }
.bars { display: grid; grid-template-columns: max-content 1fr; gap: .4rem .8rem;
  align-items: center; font-size: .92rem }
.bars div { display: flex; border-radius: 4px; overflow: hidden; height: 1.7rem }
.bars i { font-style: normal; font-size: .78rem; color: #10141a; text-align: center;
  line-height: 1.7rem; overflow: hidden; min-width: 1px; white-space: nowrap }
summary { cursor: pointer; color: #1668b8; font-size: .9rem; margin-top: .6rem }
.note + .gallery { margin-top: 1rem }
.gallery { display: grid; grid-template-columns: repeat(auto-fill, minmax(20rem, 1fr));
  gap: 1.4rem 1rem }
.shot { position: relative }
.shot img { display: block; width: 100%; height: auto; border-radius: 6px }
.shot b, li b { border-radius: 50%; color: #10141a; font-size: .72rem; text-align: center;
  width: 1.3rem; height: 1.3rem; line-height: 1.3rem; display: inline-block }
.shot b { position: absolute; transform: translate(-50%, -50%); box-shadow: 0 0 0 2px #fff }
.gallery figcaption { font-size: .85rem; margin: .4rem 0 .2rem; overflow-wrap: anywhere }
.gallery ol { list-style: none; margin: 0; padding: 0; font-size: .85rem }
.gallery li { margin: .15rem 0 }
@media (max-width: 40rem) {
  body { padding: .8rem .8rem 3rem }
  .gallery { grid-template-columns: 1fr }
  .bars { grid-template-columns: 1fr; gap: .1rem }
  .bars div { margin-bottom: .5rem }
  table { font-size: .82rem }
  caption { white-space: normal }
  th, td { padding: .28rem .4rem }
}
"""
