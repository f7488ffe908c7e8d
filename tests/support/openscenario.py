"""Builders of OpenSCENARIO files: a story of an ego and another road user, and distributions of its parameters."""

CAR = (
    '<Vehicle name="{0}" vehicleCategory="{1}"><BoundingBox><Center x="1.4" y="0" z="0.9"/>'
    '<Dimensions width="2" length="4.5" height="1.8"/></BoundingBox></Vehicle>'
)
WALKER = (
    '<Pedestrian name="w" pedestrianCategory="pedestrian"><BoundingBox><Center x="0" y="0" z="0.9"/>'
    '<Dimensions width="0.5" length="0.5" height="1.8"/></BoundingBox></Pedestrian>'
)
AT_ONCE = '<SpeedActionDynamics dynamicsShape="step" dynamicsDimension="time" value="0"/>'


def speed(value: str, dynamics: str = AT_ONCE) -> str:
    """Return a speed action."""
    target = f'<SpeedActionTarget><AbsoluteTargetSpeed value="{value}"/></SpeedActionTarget>'
    return f"<LongitudinalAction><SpeedAction>{dynamics}{target}</SpeedAction></LongitudinalAction>"


def at(position: str) -> str:
    """Return a teleport action."""
    return f"<TeleportAction><Position>{position}</Position></TeleportAction>"


def lane_change(dynamics: str) -> str:
    """Return a lane change into the ego's lane."""
    target = '<LaneChangeTarget><RelativeTargetLane entityRef="Ego" value="0"/></LaneChangeTarget>'
    return f"<LateralAction><LaneChangeAction>{dynamics}{target}</LaneChangeAction></LateralAction>"


def after_s(value: str) -> str:
    """Return a condition of a time."""
    return f'<ByValueCondition><SimulationTimeCondition value="{value}" rule="greaterOrEqual"/></ByValueCondition>'


def ego_near(condition: str) -> str:
    """Return a condition of the ego."""
    return (
        '<ByEntityCondition><TriggeringEntities triggeringEntitiesRule="any"><EntityRef entityRef="Ego"/>'
        f"</TriggeringEntities><EntityCondition>{condition}</EntityCondition></ByEntityCondition>"
    )


def story(
    other: str = CAR.format("o", "car"),
    place: str = '<RelativeLanePosition entityRef="Ego" dLane="0" ds="$Gap"/>',
    begins: str = "20",
    action: str = speed("0", '<SpeedActionDynamics dynamicsShape="linear" dynamicsDimension="rate" value="$Rate"/>'),
    condition: str = after_s("2"),
    ego: str = '<LanePosition roadId="0" laneId="-2" s="50" offset="0"/>',
    before: str = "",
) -> str:
    """Return a scenario in which another road user does something near the ego."""
    declared = "".join(
        f'<ParameterDeclaration name="{name}" parameterType="double" value="{value}"><ConstraintGroup>'
        f'<ValueConstraint rule="greaterThan" value="{low}"/><ValueConstraint rule="lessThan" value="{high}"/>'
        f"</ConstraintGroup></ParameterDeclaration>"
        for name, value, low, high in (("Gap", 40, 10, 90), ("Rate", 3, 1, 8))
    )
    return (
        f'<?xml version="1.0"?>{before}<OpenSCENARIO><FileHeader revMajor="1" revMinor="2" description="a story"/>'
        f'<ParameterDeclarations>{declared}<ParameterDeclaration name="Speed" parameterType="double" value="72"/>'
        f'<ParameterDeclaration name="Lane" parameterType="integer" value="1"/></ParameterDeclarations>'
        f'<Entities><ScenarioObject name="Ego">{CAR.format("e", "car")}</ScenarioObject>'
        f'<ScenarioObject name="Other">{other}</ScenarioObject></Entities><Storyboard><Init><Actions>'
        f'<Private entityRef="Ego"><PrivateAction>{at(ego)}</PrivateAction>'
        f"<PrivateAction>{speed('${$Speed / 3.6}')}</PrivateAction></Private>"
        f'<Private entityRef="Other"><PrivateAction>{at(place)}</PrivateAction>'
        f"<PrivateAction>{speed(begins)}</PrivateAction></Private></Actions></Init>"
        f'<Story name="s"><Act name="a"><ManeuverGroup name="g"><Actors><EntityRef entityRef="Other"/></Actors>'
        f'<Maneuver name="m"><Event name="e"><Action name="x"><PrivateAction>{action}</PrivateAction></Action>'
        f'<StartTrigger><ConditionGroup><Condition name="c" delay="0" conditionEdge="rising">{condition}</Condition>'
        f"</ConditionGroup></StartTrigger></Event></Maneuver></ManeuverGroup><StartTrigger><ConditionGroup>"
        f'<Condition name="b" delay="0" conditionEdge="none">{after_s("0")}</Condition></ConditionGroup></StartTrigger>'
        f"</Act></Story><StopTrigger/></Storyboard></OpenSCENARIO>"
    )


def varied(distribution: str, kind: str = "Stochastic", file: str = "story.xosc") -> str:
    """Return a distribution of the story's parameters."""
    return (
        f'<OpenSCENARIO><FileHeader revMajor="1" revMinor="2"/><ParameterValueDistribution>'
        f'<ScenarioFile filepath="{file}"/><{kind}>{distribution}</{kind}></ParameterValueDistribution></OpenSCENARIO>'
    )


def single(name: str, inner: str) -> str:
    """Return the distribution of one parameter."""
    return f'<StochasticDistribution parameterName="{name}">{inner}</StochasticDistribution>'
